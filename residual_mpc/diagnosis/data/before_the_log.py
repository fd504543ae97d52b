"""What the actuators held before a run's first stamp: a dead time or a lag still passes it on in the first window."""

from collections.abc import Mapping

import numpy as np

from residual_mpc.diagnosis.data.local_fit import NEAREST, REACH, local_fit
from residual_mpc.diagnosis.data.signals import Signal
from residual_mpc.logs.run import Run, held
from residual_mpc.logs.signals import noise_sigma
from residual_mpc.models import optional
from residual_mpc.models.protocol import Drive, Inverting, Robot
from residual_mpc.models.settings import Settings

UNCLEAR = 0.1  # of the first command: a speed that is no farther from its half tells nothing of one actuator alone
# of what the first commands change in the first samples, the share that is missing if nothing is given for about a
# third of them; and by how many standard errors of that share
IDLE, CERTAIN = 0.25, 3.0
FINE = 0.001  # s: steps of a replay of a robot that takes any

Signals = Mapping[tuple[int, str], Signal]


def held_before(
    robot: Robot, run: Run, i: int, signals: Signals, setting: int | None = None
) -> tuple[float | None, ...]:
    """What each actuator held before the first stamp, as far as the run shows it: a wheel's speed, a servo's position,
    no speed of a robot that stands still, no torque on one that moves as if there were none. None: the first command.
    i: the run's number in the signals; setting: which one of a merged robot it has."""
    idle = "torque" in robot.command_kinds and _idle(robot, run, i, signals, setting)
    moving = _moving(robot, run, i, signals)
    first = {a: float(held(run, f"command.{a}")[0]) for a in robot.actuators}
    joints, out = optional.actuator_joints(robot), list[float | None]()
    for actuator, joint, kind in zip(robot.actuators, joints, robot.command_kinds, strict=True):
        measured = {"speed": "velocity", "velocity": "velocity", "position": "position"}.get(kind)
        signal = signals.get((i, f"{measured}.{joint}"))
        if signal is not None and len(signal.y):
            out.append(float(signal.y[0]))
        elif kind == "torque":
            out.append(0.0 if idle else None)
        else:
            out.append(0.0 if moving and _still(actuator, moving, first) else None)
    return tuple(out)


def _still(own: str, moving: Mapping[str, float], first: Mapping[str, float]) -> bool:
    """Whether an actuator stands still rather than following its first command: by its own speed where that is clear,
    else by those of all together, which noise hides less. moving, first: of all actuators, actuator units."""
    reached = moving[own] / first[own] if first[own] != 0.0 else 0.5
    if abs(reached - 0.5) > UNCLEAR:
        return reached < 0.5
    return sum(moving[a] ** 2 - (moving[a] - first[a]) ** 2 for a in first) < 0.0


def _moving(robot: Robot, run: Run, i: int, signals: Signals) -> dict[str, float]:
    """The outputs of the actuators that make the measured motion at the first stamp, actuator units; empty where the
    robot or the run does not tell them."""
    known = _measured(robot, i, signals)
    if not isinstance(robot, Inverting) or len(known) < len(robot.states):
        return {}
    fits = {c: (local_fit(s.t, run.t[:1]), s) for c, s in known.items()}
    value = {c: float(np.nan_to_num(f.value(s.y)[0])) for c, (f, s) in fits.items()}
    rate = {c: float(np.nan_to_num(f.slope(s.y)[0])) for c, (f, s) in fits.items()}
    found = robot.outputs_from(value, rate)
    return {a: float(found[a]) for a in robot.actuators}


def _idle(robot: Robot, run: Run, i: int, signals: Signals, setting: int | None) -> bool:
    """Whether the first samples move as if the actuators gave nothing rather than their first commands: the model is
    replayed with both, and what a start that is off explains is left aside."""
    known, t0 = _measured(robot, i, signals), float(run.t[0])
    if len(known) < len(robot.states):
        return False
    near = [s.t[:NEAREST] - t0 for s in known.values() if len(s.t) >= NEAREST]
    end = max((float(t[-1]) for t in near), default=np.inf)
    if len(near) < len(known) or end > REACH:
        return False
    start: dict[str, np.ndarray] = {}
    for state in robot.states:
        signal = known[state.position]
        fit = local_fit(signal.t, run.t[:1])
        start[state.position] = np.repeat(np.nan_to_num(fit.value(signal.y)), 2)
        if state.velocity is not None:
            rate = signals.get((i, state.velocity))
            slope = fit.slope(signal.y) if rate is None else local_fit(rate.t, run.t[:1]).value(rate.y)
            start[state.velocity] = np.repeat(np.nan_to_num(slope), 2)
    dt = robot.step or FINE
    steps = int(np.ceil(end / dt)) + 1
    middle = t0 + dt * (np.arange(steps) + 0.5)
    at = np.clip(np.searchsorted(run.t, middle, side="right") - 1, 0, len(run.t) - 1)
    sent = np.stack([held(run, f"command.{a}")[at] for a in robot.actuators], axis=-1)
    rows = None if setting is None else np.full(2, setting)
    drive = Drive(dt, 0, np.stack([np.zeros_like(sent), sent]), None, np.zeros(2), rows)
    rates = {s.velocity: signals[i, s.velocity] for s in robot.states if s.velocity and (i, s.velocity) in signals}
    nodes = robot.replay(start, drive, Settings(2), (*known, *rates))
    product = size = 0.0
    for channel, signal in (known | rates).items():
        t = signal.t[:NEAREST] - t0
        without, driven = (np.interp(t, dt * np.arange(steps + 1), line) for line in nodes[channel])
        # a position that starts off, and too fast, is off by a line; a velocity by a constant
        powers = (0, 1) if channel in known else (0,)
        off = np.stack([t**n for n in powers], axis=-1)
        apart = np.stack([signal.y[: len(t)] - driven, without - driven], axis=-1)
        noise = max(noise_sigma(signal.t, signal.y), 1e-9)
        left, change = (apart - off @ np.linalg.lstsq(off, apart, rcond=None)[0]).T / noise
        product, size = product + float(left @ change), size + float(change @ change)
    return size > 0.0 and product > max(IDLE * size, CERTAIN * np.sqrt(size))


def _measured(robot: Robot, i: int, signals: Signals) -> dict[str, Signal]:
    """The position-like channels of the robot's states that the run has, by name."""
    found = {s.position: signals.get((i, s.position)) for s in robot.states}
    return {c: s for c, s in found.items() if s is not None and len(s.y) > 1}
