"""What was sent in each window, on the replay's own grid, and what the actuators held before it."""

from collections.abc import Mapping, Sequence

import numpy as np

from residual_mpc.diagnosis.data.before_the_log import held_before
from residual_mpc.diagnosis.data.local_fit import local_fit
from residual_mpc.diagnosis.data.settings import DataSettings
from residual_mpc.diagnosis.data.signals import Signal
from residual_mpc.diagnosis.data.wheel_angle import has_round_wheels, wheel_angles
from residual_mpc.logs.run import Run, held
from residual_mpc.models import optional
from residual_mpc.models.protocol import Drive, Robot

MEASURED: Mapping[str, str] = {"speed": "velocity", "position": "position"}  # kind of a command -> what shows its state


def drive_of(
    robot: Robot,
    runs: Sequence[Run],
    starts: Sequence[np.ndarray],
    horizon: float,
    index: Sequence[int],
    signals: Mapping[tuple[int, str], Signal],
    settings: DataSettings,
    variants: Sequence[int] | None = None,
) -> Drive:
    """The commands of one robot's windows on the replay's grid. runs share the robot; starts[k] (W_k,) s and index[k]
    are those of runs[k]; signals by (index, channel); variants: which setting of a merged robot each run has."""
    dt = robot.step or float(np.clip(min(r.period for r in runs) / 4.0, 0.004, 0.01))
    steps = int(np.ceil(horizon / dt - 1e-9))
    lead, after = (int(np.ceil(x / dt)) for x in (settings.dataset.lead, settings.dataset.after))
    commands, enabled, clocks, angles = [], [], [], []
    switched = any(f"enabled.{a}" in run.columns for run in runs for a in robot.actuators)
    rolls = has_round_wheels(robot) and all((i, s.position) in signals for s in robot.states for i in index)
    before = held_before(robot, runs, index, signals, variants)
    for run, t0, i, held_by in zip(runs, starts, index, before, strict=True):
        edges = t0[:, None] + dt * np.arange(-lead, steps + after + 1)[None, :]
        per_actuator = [
            _mean_held(run, held(run, f"command.{a}"), edges, x) for a, x in zip(robot.actuators, held_by, strict=True)
        ]
        warm = np.stack(per_actuator, axis=-1)
        for k in range(len(robot.actuators)):
            _settle(warm[:, 0, k], robot, k, i, edges[:, 0], signals)
        commands.append(warm)
        if rolls:
            mine = {c: (s.t, s.y) for (j, c), s in signals.items() if j == i}
            angles.append(wheel_angles(robot, run, t0, horizon, mine, settings.wheel_angle))
        clocks.append(t0 - run.t[0])
        if not switched:
            continue
        centres = 0.5 * (edges[:, :-1] + edges[:, 1:])
        at = np.clip(np.searchsorted(run.t, centres, side="right") - 1, 0, len(run.t) - 1)
        on = [
            held(run, f"enabled.{a}")[at] if f"enabled.{a}" in run.columns else np.ones(at.shape)
            for a in robot.actuators
        ]
        enabled.append(np.where(np.isnan(on), 1.0, on).transpose(1, 2, 0))
    sent, end = np.concatenate(commands), lead + steps
    on_all = np.concatenate(enabled) if switched else np.ones((1, 1, 1))
    always = bool((on_all[:, :end] == 1).all())
    return Drive(
        dt,
        lead,
        sent[:, :end],
        None if always else on_all[:, lead:end],
        np.concatenate(clocks),
        enabled_before=None if always else on_all[:, :lead],
        command_after=sent[:, end:],
        enabled_after=None if always else on_all[:, end:],
        angle=np.concatenate(angles) if rolls else None,
    )


def _settle(
    first: np.ndarray, robot: Robot, k: int, i: int, at: np.ndarray, signals: Mapping[tuple[int, str], Signal]
) -> None:
    """Start a wheel's warm-up at its measured speed, and a position servo's at the setpoint that its measured motion
    implies without load. Otherwise a slow lag or rate limit would start from the command rather than from the setpoint
    that it has reached. first (W,): the first command of each window's warm-up, changed in place; at (W,) s."""
    joint, measured = optional.actuator_joints(robot)[k], MEASURED.get(robot.command_kinds[k])
    signal = None if measured is None else signals.get((i, f"{measured}.{joint}"))
    if signal is None:
        return
    fit = local_fit(signal.t, at)
    found = fit.value(signal.y)
    if measured == "position":
        ahead = optional.servo_lags(robot)[k] * np.nan_to_num(fit.slope(signal.y))
        found = optional.gear_ratios(robot)[k] * (found + ahead)
    first[:] = np.where((fit.count > 0) & np.isfinite(found), found, first)


def _mean_held(run: Run, u: np.ndarray, edges: np.ndarray, before: float | None) -> np.ndarray:
    """(W, K) mean of the held command u (n,) over each interval of edges (W, K + 1) s."""
    t = run.t
    first = u[0] if before is None else before
    total = np.concatenate([[0.0], np.cumsum(u[:-1] * np.diff(t))])
    at = np.searchsorted(t, edges, side="right") - 1
    inside = np.clip(at, 0, len(t) - 1)
    integral = np.where(at < 0, first * (edges - t[0]), total[inside] + u[inside] * (edges - t[inside]))
    return np.asarray(np.diff(integral, axis=1) / np.diff(edges, axis=1))
