"""What the actuators held before a run's first stamp: a dead time or a lag still passes it on in the first window."""

from collections.abc import Mapping, Sequence

import numpy as np

from residual_mpc.diagnosis.data.local_fit import NEAREST, REACH, local_fit
from residual_mpc.diagnosis.data.reached_setpoints import reached
from residual_mpc.diagnosis.data.signals import Signal
from residual_mpc.logs.run import Run, held
from residual_mpc.logs.signals import noise_sigma, resolution
from residual_mpc.models import optional
from residual_mpc.models.protocol import Drive, Inverting, Robot
from residual_mpc.models.settings import Settings

CERTAIN = 3.0  # standard errors by which one account of the first samples has to be better than another
SAMPLES = 2 * NEAREST  # looked at, as far as they lie within REACH of the start
LITTLE = 0.25  # share of the commanded motion below which all these samples say that nothing was given yet
SPLIT = 2.0 * np.log(5.0)  # deviance for which one actuator is taken to do something else than all together
FITS = 2.0 / 3.0  # of what torques from the start leave; the motors gave something else if a later start leaves more
RESTING = 0.3  # s in which a joint that stands still under a constant command shows that it has come to rest
FINE = 0.001  # s: steps of a replay of a robot that takes any

Signals = Mapping[tuple[int, str], Signal]


def held_before(
    robot: Robot, runs: Sequence[Run], index: Sequence[int], signals: Signals, variants: Sequence[int] | None = None
) -> list[tuple[float | None, ...]]:
    """What each actuator held before the first stamp of each run, as far as the runs show it: a wheel's speed, a
    servo's first command or position, no speed of a robot that stands still, no torque where all runs together move
    as if there were none. None: the first command. index: the runs' numbers in the signals; variants: which one of
    a merged robot each has."""
    idle = "torque" in robot.command_kinds and _idle(robot, runs, index, signals, variants)
    return [_held_before(robot, run, i, signals, idle) for run, i in zip(runs, index, strict=True)]


def _held_before(robot: Robot, run: Run, i: int, signals: Signals, idle: bool) -> tuple[float | None, ...]:
    moving, error = _moving(robot, run, i, signals)
    first = {a: float(held(run, f"command.{a}")[0]) for a in robot.actuators}
    joints, out = optional.actuator_joints(robot), list[float | None]()
    setpoints, at_rest = (reached(robot, i, run.t[:1], signals, moves)[0] for moves in (True, False))
    for k, (actuator, joint, kind) in enumerate(zip(robot.actuators, joints, robot.command_kinds, strict=True)):
        measured = {"speed": "velocity", "velocity": "velocity", "position": "position"}.get(kind)
        signal = signals.get((i, f"{measured}.{joint}"))
        if signal is not None and len(signal.y):
            scale = optional.gear_ratios(robot)[k] if kind == "position" else 1.0
            there = scale * float(signal.y[0])  # units of the command
            if kind == "position" and _rests(run, actuator, signal):
                out.append(first[actuator])
            elif kind == "position" and np.isfinite(setpoints[k]):
                out.append(_setpoint(float(setpoints[k]), float(at_rest[k]), there, first[actuator]))
            else:
                out.append(there)
        elif kind == "torque":
            out.append(0.0 if idle else None)
        else:
            out.append(0.0 if moving and _still(actuator, moving, error, first) else None)
    return tuple(out)


def _rests(run: Run, actuator: str, signal: Signal) -> bool:
    """Whether a joint stands still while its command stays as it is, so that it has come to where that leads."""
    early = run.t <= run.t[0] + RESTING
    sent, mine = held(run, f"command.{actuator}")[early], signal.t <= run.t[0] + RESTING
    t, y = signal.t[mine], signal.y[mine]
    if len(t) < NEAREST or np.ptp(sent) > 0.0:
        return False
    line = np.linalg.pinv(np.stack([np.ones_like(t), t - t[0]], axis=-1))[1]  # (n,) 1/s
    noise = CERTAIN * noise_sigma(signal.t, signal.y) * float(np.linalg.norm(line))
    return bool(abs(line @ y) <= noise + resolution(signal.y) / RESTING)


def _setpoint(needed: float, at_rest: float, measured: float, first: float) -> float:
    """What a position servo held, units of its command: the first command, where load and friction may be why the joint
    is not there; else where the joint was, ahead of it by what its damping takes at the measured speed. needed: the
    setpoint that sustains the motion under the load; at_rest: the position alone; measured: without any load."""
    low, high = sorted((needed, measured))
    near = abs(needed - measured)
    return first if low - near <= first <= high + near else measured + needed - at_rest


def _still(own: str, moving: Mapping[str, float], error: Mapping[str, float], first: Mapping[str, float]) -> bool:
    """Whether an actuator stands still rather than following its first command. All of them are taken to do the same,
    which noise hides less, unless this one's speed says otherwise: five to one. moving, first: of all
    actuators, actuator units; error: the standard errors of the former."""
    costs = {a: np.array([moving[a] ** 2, (moving[a] - first[a]) ** 2]) / max(error[a], 1e-9) ** 2 for a in first}
    still, follows = np.sum(list(costs.values()), axis=0)
    own_still, own_follows = costs[own]
    if still < follows:
        return bool(own_still <= own_follows + SPLIT)
    return bool(own_still < own_follows - SPLIT)


def _moving(robot: Robot, run: Run, i: int, signals: Signals) -> tuple[dict[str, float], dict[str, float]]:
    """The outputs of the actuators that make the measured motion at the first stamp, and their standard errors,
    actuator units; empty where the robot or the run does not tell them."""
    known = _measured(robot, i, signals)
    if not isinstance(robot, Inverting) or len(known) < len(robot.states):
        return {}, {}
    fits = {c: (local_fit(s.t, run.t[:1]), s) for c, s in known.items()}
    value = {c: float(np.nan_to_num(f.value(s.y)[0])) for c, (f, s) in fits.items()}
    rate = {c: float(np.nan_to_num(f.slope(s.y)[0])) for c, (f, s) in fits.items()}
    found, square = robot.outputs_from(value, rate), dict.fromkeys(robot.actuators, 0.0)
    for c, (f, s) in fits.items():
        off = noise_sigma(s.t, s.y) * float(np.linalg.norm(f.slope_weights[0]))
        moved = robot.outputs_from(value, {**rate, c: rate[c] + off})
        square = {a: x + (moved[a] - found[a]) ** 2 for a, x in square.items()}
    return {a: float(found[a]) for a in robot.actuators}, {a: float(np.sqrt(x)) for a, x in square.items()}


def _idle(
    robot: Robot, runs: Sequence[Run], index: Sequence[int], signals: Signals, variants: Sequence[int] | None
) -> bool:
    """Whether the motors that take torques gave nothing at first, rather than what they were told or a share of it: it
    has to be better than torques from the start by `CERTAIN` standard errors a run, and leave at most the share `FITS`
    of what they leave, in the geometric mean of the runs, whose errors differ in size."""
    ways = [None] * len(runs) if variants is None else variants
    found = [_accounts(robot, run, i, signals, v) for run, i, v in zip(runs, index, ways, strict=True)]
    costs = np.array([c for c in found if c is not None]).reshape(-1, 2)
    if not len(costs):
        return False
    told, later = costs.T
    gained = float(np.sum(told - later)) > CERTAIN**2 * len(costs)
    return gained and float(np.mean(np.log(later / told))) < np.log(FITS)


def _accounts(robot: Robot, run: Run, i: int, signals: Signals, setting: int | None) -> tuple[float, float] | None:
    """The squared errors of a run's first samples, in units of the noise, with torques from the start, and with torques
    that begin when they fit best; None where the samples tell nothing.

    The model is replayed with torques that begin at or between these samples, and nothing before, each with a share of
    the torques fitted, as a weak motor, a load or friction would leave, unless hardly any of the motion is there. What
    a start that is off explains is left aside.
    """
    known, t0 = _measured(robot, i, signals), float(run.t[0])
    if len(known) < len(robot.states):
        return None
    near = [t[t <= REACH][:SAMPLES] for t in (s.t - t0 for s in known.values())]
    if min((len(t) for t in near), default=0) < NEAREST:
        return None
    end = max(float(t[-1]) for t in near)
    dt = robot.step or FINE
    steps = int(np.ceil(end / dt)) + 1
    middle = dt * (np.arange(steps) + 0.5)
    at = np.clip(np.searchsorted(run.t, t0 + middle, side="right") - 1, 0, len(run.t) - 1)
    sent = np.stack([held(run, f"command.{a}")[at] for a in robot.actuators], axis=-1)
    begins = np.append(np.linspace(0.0, end, 2 * max(map(len, near)) - 1), np.inf)  # s: from when on there are torques
    off = middle[None, :, None] < begins[:, None, None]
    torques = np.array([kind == "torque" for kind in robot.command_kinds])
    rows = len(begins)
    drive = Drive(dt, 0, np.where(off & torques, 0.0, sent[None]), None, np.zeros(rows), _settings(setting, rows))
    rates = {s.velocity: signals[i, s.velocity] for s in robot.states if s.velocity and (i, s.velocity) in signals}
    nodes = robot.replay(_start(robot, run, i, signals, known, rows), drive, Settings(rows), (*known, *rates))
    if not all(np.isfinite(x).all() for x in nodes.values()):
        return None
    apart = []
    for channel, signal in (known | rates).items():
        t = signal.t[: len(near[0])] - t0
        seen = signal.y[: len(t)] - np.stack([np.interp(t, dt * np.arange(steps + 1), x) for x in nodes[channel]])
        # a position that starts off, and too fast, is off by a line; a velocity by a constant
        free = np.stack([t**n for n in ((0, 1) if channel in known else (0,))], axis=-1)
        left = seen.T - free @ np.linalg.lstsq(free, seen.T, rcond=None)[0]
        apart.append(left / max(noise_sigma(signal.t, signal.y), 1e-9))
    left = np.concatenate(apart)  # (samples, rows) in units of the noise
    moved = left[:, -1:] - left[:, :-1]  # by the torques of each row but the last
    size = np.sum(moved**2, axis=0)
    if not (size > 0.0).all():
        return None
    share = np.clip(left[:, -1] @ moved / size, 0.0, None)
    cost = np.sum((left[:, -1:] - share * moved) ** 2, axis=0)
    if share[0] < LITTLE:  # as good as nothing in all these samples
        return max(float(np.sum(left[:, 0] ** 2)), 1e-12), max(float(cost[0]), 1e-12)
    return max(float(cost[0]), 1e-12), max(float(cost.min()), 1e-12)


def _settings(setting: int | None, rows: int) -> np.ndarray | None:
    return None if setting is None else np.full(rows, setting)


def _start(
    robot: Robot, run: Run, i: int, signals: Signals, known: Mapping[str, Signal], rows: int
) -> dict[str, np.ndarray]:
    """The measured state at the first stamp, the same in all rows."""
    start: dict[str, np.ndarray] = {}
    for state in robot.states:
        signal = known[state.position]
        fit = local_fit(signal.t, run.t[:1])
        start[state.position] = np.repeat(np.nan_to_num(fit.value(signal.y)), rows)
        if state.velocity is not None:
            rate = signals.get((i, state.velocity))
            slope = fit.slope(signal.y) if rate is None else local_fit(rate.t, run.t[:1]).value(rate.y)
            start[state.velocity] = np.repeat(np.nan_to_num(slope), rows)
    return start


def _measured(robot: Robot, i: int, signals: Signals) -> dict[str, Signal]:
    """The position-like channels of the robot's states that the run has, by name."""
    found = {s.position: signals.get((i, s.position)) for s in robot.states}
    return {c: s for c, s in found.items() if s is not None and len(s.y) > 1}
