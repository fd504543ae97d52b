"""What the remainder might depend on, at every sample: motion, commands, time, angles, and whatever else was logged."""

from dataclasses import dataclass

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.remainder.loads import Loads
from residual_mpc.diagnosis.remainder.missing_rates import POSE, travelled
from residual_mpc.diagnosis.remainder.settings import RemainderSettings
from residual_mpc.logs.run import Run, held
from residual_mpc.models import optional


@dataclass(frozen=True, eq=False)
class Coordinate:
    """name: of what, in words; kind: of which sort (see KINDS); of: the actuator, joint or column, None for the robot;
    z (W, M) in `unit`; turn: the period in z of what repeats, None where nothing does; multiplier (W, M): a speed or
    torque that its influence is in proportion to, where it can be no other."""

    name: str
    kind: str
    of: str | None
    unit: str
    z: np.ndarray
    turn: float | None = None
    multiplier: np.ndarray | None = None


KINDS = (
    "steady", "speed", "turning", "cornering", "command", "command_rate", "position", "direction", "angle",
    "load", "wheel_angle", "heading", "place", "time", "work", "run", "order", "logged",
)  # fmt: skip
PER_RUN = ("wheel_angle", "run", "order")  # these are told from each other within runs, the others across runs


def coordinates(data: Dataset, predicted: np.ndarray, settings: RemainderSettings) -> tuple[Coordinate, ...]:
    """Every candidate of these runs but the loads; predicted (W, M, C): by the model at hand, which has no sensor's
    noise."""
    out = [Coordinate("nothing that changes", "steady", None, "", np.zeros(data.t.shape))]
    out += _planar_motion(data, predicted)
    for k, c in enumerate(data.channels):
        if c.startswith("position."):
            joint = c.removeprefix("position.")
            q, v = np.nan_to_num(predicted[..., k]), rate(predicted[..., k], data.t)
            out += [
                Coordinate(f"the speed of {joint}", "speed", joint, "rad/s", v),
                Coordinate(f"the position of {joint}", "position", joint, "rad", q),
                Coordinate(f"the angle of {joint}", "angle", joint, "rad", q, turn=2.0 * np.pi),
                Coordinate(
                    f"the direction of motion of {joint}", "direction", joint, "", _last_direction(v, settings=settings)
                ),
            ]
    out += _commands(data, settings=settings)
    out += _slow(data)
    out += _logged(data)
    return _moving(data, out)


def load_coordinates(data: Dataset, loads: Loads) -> tuple[Coordinate, ...]:
    """The loads on the joints of these runs (see `joint_loads`).

    Not of joints whose commands are all torques: a law of the command is the same there.
    """
    robot = data.blocks[0].robot
    slides = optional.sliding(robot)
    joints = zip(optional.actuator_joints(robot), robot.command_kinds, strict=True) if loads else ()
    asked = {j for j, kind in joints if kind != "torque"}
    units = {j: "N" if j in slides else "N m" for j in loads}
    return _moving(data, [Coordinate(f"the load on {j}", "load", j, units[j], loads[j]) for j in loads if j in asked])


def lever_coordinates(data: Dataset, predicted: np.ndarray, loads: Loads) -> tuple[Coordinate, ...]:
    """The positions of the joints, as what a share of the loads there may depend on; predicted (W, M, C): as for
    `coordinates`. Laws are made of these; what is left is not described by them."""
    slides, out = optional.sliding(data.blocks[0].robot), []
    for joint, load in loads.items():
        if (channel := f"position.{joint}") in data.channels:
            q = np.nan_to_num(predicted[..., data.channels.index(channel)])
            unit = "m" if joint in slides else "rad"
            out.append(Coordinate(f"the position of {joint}", "lever", joint, unit, q, multiplier=load))
    return _moving(data, out)


def _moving(data: Dataset, some: list[Coordinate]) -> tuple[Coordinate, ...]:
    seen = np.isfinite(data.t)
    return tuple(c for c in some if c.kind == "steady" or float(np.std(c.z[seen])) > 1e-9)


def rate(x: np.ndarray, t: np.ndarray) -> np.ndarray:
    """(W, M) per second, by central differences of x (W, M) at times t (W, M) s; 0 where padded."""
    with np.errstate(invalid="ignore", divide="ignore"):
        slope = np.diff(x, axis=1) / np.diff(t, axis=1)
    slope = np.where(np.isfinite(slope), slope, np.nan)
    both = np.stack([np.pad(slope, ((0, 0), (1, 0)), "edge"), np.pad(slope, ((0, 0), (0, 1)), "edge")])
    count = np.isfinite(both).sum(axis=0)
    return np.asarray(np.nansum(both, axis=0) / np.maximum(count, 1))


def _planar_motion(data: Dataset, predicted: np.ndarray) -> list[Coordinate]:
    if not set(POSE) <= set(data.channels):
        return []
    pose = predicted[..., [data.channels.index(c) for c in POSE]]
    x, y, theta = np.moveaxis(pose, -1, 0)
    way = travelled(pose, np.isfinite(x))
    ahead, turning = rate(way[..., 0], data.t), rate(way[..., 2], data.t)
    return [
        Coordinate("the forward speed", "speed", None, "m/s", ahead),
        Coordinate("the turning rate", "turning", None, "rad/s", turning),
        Coordinate("speed times turning rate", "cornering", None, "m/s^2", ahead * turning),
        Coordinate("the heading", "heading", None, "rad", np.nan_to_num(theta), turn=2.0 * np.pi),
        Coordinate("the x position", "place", "pose.x", "m", np.nan_to_num(x)),
        Coordinate("the y position", "place", "pose.y", "m", np.nan_to_num(y)),
    ]


def _commands(data: Dataset, settings: RemainderSettings) -> list[Coordinate]:
    out = []
    robot = data.blocks[0].robot
    for a, kind in zip(robot.actuators, robot.command_kinds, strict=True):
        wheel = kind == "speed"
        unit = {"position": "rad", "torque": "N m"}.get(kind, "rad/s")
        per_run = [_series(run, f"command.{a}") for run in data.runs]
        u = _at_samples(data, per_run)
        out.append(Coordinate(f"the command of {a}", "command", a, unit, u))
        rates = [_rate_of(run, s, settings=settings) for run, s in zip(data.runs, per_run, strict=True)]
        out.append(
            Coordinate(f"the rate of the command of {a}", "command_rate", a, f"{unit}/s", _at_samples(data, rates))
        )
        if wheel:
            angle, speed = _wheel(data, a, per_run)
            out.append(
                Coordinate(f"the angle of the {a} wheel", "wheel_angle", a, "rad", angle, 2.0 * np.pi, multiplier=speed)
            )
    return out


def _wheel(data: Dataset, a: str, commands: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """(W, M) rad since the run's start and rad/s: by the encoder where there is one, else as commanded."""
    speeds = []
    for i, run in enumerate(data.runs):
        signal = data.signals.get((i, f"velocity.{a}"))
        seen = signal is not None and len(signal.t) > 1
        speeds.append(np.interp(run.t, signal.t, signal.y) if seen and signal is not None else commands[i])
    angles = [
        np.concatenate([[0.0], np.cumsum(0.5 * (s[1:] + s[:-1]) * np.diff(run.t))])
        if (i, f"velocity.{a}") in data.signals
        else np.concatenate([[0.0], np.cumsum(s[:-1] * np.diff(run.t))])
        for i, (run, s) in enumerate(zip(data.runs, speeds, strict=True))
    ]
    return _at_samples(data, angles), _at_samples(data, speeds)


def _slow(data: Dataset) -> list[Coordinate]:
    """What changes over a run, or from run to run."""
    since = [run.t - run.t[0] for run in data.runs]
    robot = data.blocks[0].robot
    work = []
    for run in data.runs:
        done = np.zeros(len(run.t))
        for a, kind in zip(robot.actuators, robot.command_kinds, strict=True):
            u = _series(run, f"command.{a}")
            step = np.abs(np.diff(u)) if kind == "position" else np.abs(u[:-1]) * np.diff(run.t)
            done[1:] += np.cumsum(step)
        work.append(done)
    every = np.broadcast_to(data.run[:, None], data.t.shape).astype(float)
    out = [
        Coordinate("the time in the run", "time", None, "s", _at_samples(data, since)),
        Coordinate("the accumulated motor activity in the run", "work", None, "", _at_samples(data, work)),
    ]
    if len(data.runs) > 1:
        out.append(Coordinate("the run", "run", None, "", every))
    if len(data.runs) >= 8:
        out.append(Coordinate("the order of the runs", "order", None, "", every))
    return out


def _logged(data: Dataset) -> list[Coordinate]:
    """Columns that no channel of the comparison is: efforts, temperatures, whatever else is a number."""
    names: dict[str, None] = {}
    for run in data.runs:
        names |= dict.fromkeys(c for c in (*run.columns, *run.extra_columns) if not c.startswith("command."))
    out = []
    for c in names:
        known = c in data.channels and data.compared[:, data.channels.index(c)].any()
        if known or c.split(".")[0] in ("position", "pose", "velocity", "twist", "enabled"):
            continue
        series = [_column(run, c) for run in data.runs]
        out.append(Coordinate(f"the logged {c}", "logged", c, "", _at_samples(data, series)))
    return out


def _column(run: Run, name: str) -> np.ndarray:
    """(n,) with its gaps bridged; its mean where the run has it not."""
    values = run.columns.get(name, run.extra_columns.get(name))
    if values is None or not np.isfinite(values).any():
        return np.zeros(len(run.t))
    good = np.isfinite(values)
    return np.interp(run.t, run.t[good], values[good])


def _series(run: Run, column: str) -> np.ndarray:
    values = held(run, column)
    return np.where(np.isfinite(values), values, values[np.isfinite(values)][0])


def _rate_of(run: Run, u: np.ndarray, settings: RemainderSettings) -> np.ndarray:
    ahead, behind = (np.interp(run.t + s * settings.coordinates.rate_over, run.t, u) for s in (1.0, -1.0))
    return np.asarray((ahead - behind) / (2.0 * settings.coordinates.rate_over))


def _at_samples(data: Dataset, series: list[np.ndarray]) -> np.ndarray:
    """(W, M) of one series (n,) a run, on its own stamps."""
    out = np.zeros(data.t.shape)
    for w, i in enumerate(data.run):
        t = data.runs[i].t
        real = np.isfinite(data.t[w])
        out[w, real] = np.interp(data.t[w, real] + data.start[w], t, series[i])
    return out


def _last_direction(v: np.ndarray, settings: RemainderSettings) -> np.ndarray:
    """(W, M) -1, 0 or 1: the sign of the last speed that was clearly one."""
    usual = settings.coordinates.clear * float(np.quantile(np.abs(v), 0.9)) + 1e-12
    sign = np.where(np.abs(v) > usual, np.sign(v), 0.0)
    last = np.maximum.accumulate(np.where(sign != 0.0, np.arange(v.shape[1])[None, :], 0), axis=1)
    return np.asarray(np.take_along_axis(sign, last, axis=1))


def own_motion(data: Dataset, predicted: np.ndarray) -> dict[str, np.ndarray]:
    """(W, M) the speed that belongs to each component of what is missed."""
    planar = {c.kind: c.z for c in _planar_motion(data, predicted)}
    names = {"speed": "forward", "turning": "yaw", "cornering": "sideways"}
    out = {name: planar[kind] for kind, name in names.items() if kind in planar}
    for k, c in enumerate(data.channels):
        if c.startswith("position."):
            out[c] = rate(predicted[..., k], data.t)
        elif c.startswith(("twist.", "velocity.")):
            out[c] = np.nan_to_num(predicted[..., k])
    return out
