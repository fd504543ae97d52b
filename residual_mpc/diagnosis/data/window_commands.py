"""What was sent in each window, on the replay's own grid, and what the actuators held before it."""

from collections.abc import Mapping, Sequence

import numpy as np

from residual_mpc.diagnosis.data.before_the_log import held_before
from residual_mpc.diagnosis.data.reached_setpoints import reached
from residual_mpc.diagnosis.data.settings import DataSettings
from residual_mpc.diagnosis.data.signals import Signal
from residual_mpc.diagnosis.data.wheel_angle import has_round_wheels, wheel_angles
from residual_mpc.logs.run import Run, held
from residual_mpc.models.protocol import Drive, Robot


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
        found = reached(robot, i, edges[:, 0], signals)
        warm[:, 0] = np.where(np.isfinite(found), found, warm[:, 0])
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


def _mean_held(run: Run, u: np.ndarray, edges: np.ndarray, before: float | None) -> np.ndarray:
    """(W, K) mean of the held command u (n,) over each interval of edges (W, K + 1) s."""
    t = run.t
    first = u[0] if before is None else before
    total = np.concatenate([[0.0], np.cumsum(u[:-1] * np.diff(t))])
    at = np.searchsorted(t, edges, side="right") - 1
    inside = np.clip(at, 0, len(t) - 1)
    integral = np.where(at < 0, first * (edges - t[0]), total[inside] + u[inside] * (edges - t[inside]))
    return np.asarray(np.diff(integral, axis=1) / np.diff(edges, axis=1))
