"""Draft a robot file for a built-in robot such as `diff_drive`, whose channels are known and matched to the log's."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from residual_mpc.errors import BadInput
from residual_mpc.init.calibration.units import SPEEDS
from residual_mpc.init.columns.evidence import Roles
from residual_mpc.init.columns.guess import Guess, LogCorrection
from residual_mpc.init.columns.recording import Recording, column_words, read_recordings
from residual_mpc.init.columns.signals import CLEAR, Signals, gather
from residual_mpc.init.columns.time_column import Clock, find_clock, seconds
from residual_mpc.init.columns.words import ColumnName, core_of, likeness
from residual_mpc.init.draft import Draft, Unmatched, log_entries, run_guess
from residual_mpc.init.roles.planar_pose import find_pose, heading_in_degrees, places_in_small_units
from residual_mpc.init.roles.wheel_encoders import ALIKE, sides, turning_wheel, unused_columns
from residual_mpc.logs.columns import group, is_measured, member
from residual_mpc.models.load import load_robot
from residual_mpc.models.robot_file import WHEELS, RobotFile

HELD, FOLLOWED = 1.0, 0.8  # s over which motions are compared; correlation from which these tell the geometry
BODY = ("command.linear", "command.angular")
CONVERTED = "; it must be the base controller's, since the body velocity is converted to wheel speeds with it"
ANGLES = frozenset("position positions pos angle angles ang".split())  # words of columns that hold no ticks
RADIANS = (None, "rad", "radian", "radians", "rads")
SURE = 0.99  # correlation of odometry and wheel speeds above which the odometry determines the wheels' geometry


def draft_built_in(name: str, paths: Sequence[str | Path]) -> Draft:
    """Guess the robot file of a built-in robot.

    Raises BadInput for an unknown name, runs that cannot be read, and runs without a command or a measurement.
    """
    model = load_robot(RobotFile(name, name))
    recordings = read_recordings(paths)
    clock = find_clock(recordings)
    signals = gather(recordings, clock)
    words = column_words(signals.names, recordings)
    known = {key: column for r in recordings for key, column in r.preferred.items()}
    wanted = [*(f"command.{a}" for a in model.actuators), *model.channels]
    guesses: list[Guess] = []
    for key in wanted:
        guess = _column(key, signals, words, known) or _wheel_speed(key, guesses, signals, words)
        guesses += [] if guess is None else [guess]
    guesses += _wheel_angles(model.channels, guesses, signals, words, known)
    nominal = model.nominal()
    if set(WHEELS) <= set(nominal) and not any(g.what.startswith("command.") for g in guesses):
        sent = known if set(BODY) <= set(known) else _body_velocity(words)
        guesses += [Guess(k, sent[k], "a body velocity, which the wheels' geometry turns into wheel speeds", 0.9)
                    for k in BODY if set(BODY) <= set(sent)]  # fmt: skip
    if not any(g.what.startswith("pose.") for g in guesses):
        taken = {g.value for g in guesses}
        found, _ = find_pose({n: w for n, w in words.items() if n not in taken}, signals)
        new = [g for g in found.guesses if g.what in wanted or g.what.startswith("pose.q")]
        guesses += [g for g in new if g.what not in {h.what for h in guesses}]
    roles = {g.what: g.value for g in guesses}
    _refuse_empty(name, roles, signals.names, str(recordings[0].source))
    held = Roles(roles, tuple(guesses))
    mends = (
        *heading_in_degrees(signals, held),
        *places_in_small_units(signals, held),
        *(wheel_speeds_in_named_units(words, held) if set(WHEELS) <= set(nominal) else ()),
    )
    parameters, reasons = _parameters(nominal, roles, recordings, clock, {m.column: m.factor for m in mends})
    return Draft(
        name,
        name,
        None,
        log_entries(roles, clock.column, recordings),
        {},
        None,
        None,
        (),
        (),
        (),
        (*clock.guesses, *run_guess(recordings), *guesses, *reasons),
        (*clock.mends, *mends),
        unused_columns(name, roles, guesses, signals, words),
        _missing(wanted, roles),
        tuple(dict.fromkeys(note for r in recordings for note in r.notes)),
        parameters,
    )


def _body_velocity(words: Mapping[str, ColumnName]) -> dict[str, str]:
    """The forward speed and the yaw rate of a command such as ROS's cmd_vel, by their columns' names."""
    found: dict[str, str] = {}
    for key, motion, axis in zip(BODY, ("linear", "angular"), ("x", "z"), strict=True):
        said = {n: set(w.every) for n, w in words.items() if w.commanded and motion in w.every}
        named = [n for n, every in said.items() if axis in every or not every & {"x", "y", "z"}]
        if named:
            found[key] = named[0]
    return found


def _column(key: str, signals: Signals, words: Mapping[str, ColumnName], known: Mapping[str, str]) -> Guess | None:
    """The column of one name of the log format."""
    if key in signals.names:
        return Guess(key, key, "its name", 0.99)
    if key in known:
        return Guess(key, known[key], "the type of its topic", 0.95)
    kind = group(key)
    if kind not in ("command", "position", "velocity"):
        return None
    core = core_of(member(key))
    likely = {n: likeness(sides(w), core) for n, w in words.items() if _is_kind(w, kind)}
    best = [n for n, alike in likely.items() if alike >= ALIKE and alike == max(likely.values())]
    if not best:
        return None
    why = f"its name resembles {member(key)} and says {kind}"
    return Guess(key, best[0], why, 0.5 if len(best) > 1 else 0.85, tuple(best[1:]))


def _wheel_speed(key: str, guesses: Sequence[Guess], signals: Signals, words: Mapping[str, ColumnName]) -> Guess | None:
    """The column of a wheel's encoder that says no more than that, where its values follow the wheel's command as a
    speed does, and not as an angle."""
    command = next((g.value for g in guesses if g.what == f"command.{member(key)}"), None)
    if group(key) != "velocity" or command is None:
        return None
    core = core_of(member(key))
    for name, w in words.items():
        if w.commanded or w.quantity not in (None, "position") or likeness(sides(w), core) < ALIKE:
            continue
        speed, angle = (signals.follows(command, name, answer_rate=rate, levels=True) for rate in (False, True))
        if speed.correlation > max(CLEAR, angle.correlation):
            return Guess(key, name, f"it {speed.words(command)} as a speed", 0.8)
    return None


def _wheel_angles(
    channels: Sequence[str],
    guesses: Sequence[Guess],
    signals: Signals,
    words: Mapping[str, ColumnName],
    known: Mapping[str, str],
) -> list[Guess]:
    """The columns of wheels' angles in rad, of which the model predicts the speeds alone."""
    found = []
    free = {n: w for n, w in words.items() if n not in {g.value for g in guesses}}
    plain = {n: w for n, w in words.items() if set(w.every) & ANGLES and w.unit in RADIANS}
    for speed in (c for c in channels if group(c) == "velocity"):
        angle = f"position.{member(speed)}"
        if angle in channels:
            continue
        guess = _column(angle, signals, plain, known) or turning_wheel(angle, guesses, signals, free)
        if guess is not None:
            found.append(replace(guess, why=f"{guess.why}; its speed is used where {speed} is not logged"))
    return found


def wheel_speeds_in_named_units(words: Mapping[str, ColumnName], roles: Roles) -> tuple[LogCorrection, ...]:
    """Speeds of wheels, measured or commanded, whose names say another unit than rad/s."""
    out = []
    for role, column in roles.columns.items():
        said = words[column].unit if group(role) in ("command", "velocity") and column in words else None
        unit = next((u for u in SPEEDS if said in u.words and not u.counts), None)
        if unit is not None and unit.size != 1.0:
            out.append(LogCorrection(column, unit.size, 0.0, f"its name says {unit.name}", 0.95))
    return tuple(out)


def _is_kind(words: ColumnName, kind: str) -> bool:
    if kind == "command":
        return words.commanded and words.quantity in (None, "velocity")
    return words.quantity == kind and not words.commanded


def _parameters(
    nominal: Mapping[str, float],
    roles: Mapping[str, str],
    recordings: Sequence[Recording],
    clock: Clock,
    factors: Mapping[str, float],
) -> tuple[dict[str, float], list[Guess]]:
    """The nominal parameters, estimated from the odometry if it was computed from the wheel speeds of the log. factors:
    by column, to the units of the log format."""
    told = _geometry(roles, recordings, clock) if set(WHEELS) == set(nominal) else None
    sent = CONVERTED if set(BODY) <= set(roles) else ""
    if told is not None:
        why = "least squares of the odometry's own speed on the wheel speeds; check it against the robot"
        return told, [Guess(f"parameters.{k}", f"{v:.6g}", why + sent, 0.8) for k, v in told.items()]
    why = f"the built-in robot's value: write that of your robot{sent}"
    rough = _driven_geometry(roles, recordings, clock, factors) if set(WHEELS) == set(nominal) else {}
    reasons = [Guess(f"parameters.{k}", f"{v:.6g}", why + rough.get(k, ""), 0.1) for k, v in nominal.items()]
    return dict(nominal), reasons


def _driven_geometry(
    roles: Mapping[str, str], recordings: Sequence[Recording], clock: Clock, factors: Mapping[str, float]
) -> dict[str, str]:
    """What the commands and the pose say of each nominal number, as a hint: the motion is that of the real robot, whose
    differences from the number on its drawing a diagnosis looks for. The wheels may be late by up to HELD s."""
    names = ("pose.x", "pose.y", "pose.theta", "command.left", "command.right")
    if not set(names) <= set(roles):
        return {}
    found = []
    for late in np.arange(0.0, HELD, 0.05):
        parts = []
        for r in recordings:
            if not {roles[n] for n in names} <= set(r.columns):
                return {}
            t = seconds(clock, r)
            x, y, theta, left, right = (factors.get(roles[n], 1.0) * _at(t, t, r.columns[roles[n]]) for n in names)
            parts.append(_moved(t, x, y, np.unwrap(theta), left, right, float(late)))
        ahead, yaw, by_left, by_right = np.concatenate(parts, axis=1)
        radius, one = _slope(0.5 * (by_left + by_right), ahead)
        rate, other = _slope(by_right - by_left, yaw)
        found.append((min(one, other), radius, rate))
    sure, radius, rate = max(found)
    if sure < FOLLOWED or radius <= 0.0 or rate <= 0.0:
        return {}
    said = ((radius, "at least about"), (radius / rate, "about"))  # slow motors fall short of fast commands
    return {
        name: f" (these runs suggest {much} {value:.2g} m)"
        for name, (value, much) in zip(WHEELS, said, strict=True)
    }


def _moved(
    t: np.ndarray, x: np.ndarray, y: np.ndarray, theta: np.ndarray, left: np.ndarray, right: np.ndarray, late: float
) -> np.ndarray:
    """(4, n) forward motion m, turn rad, and what each wheel was told to turn rad, over stretches of HELD s, commands
    `late` s earlier."""
    held = int(np.ceil(HELD / max(float(np.median(np.diff(t))), 1e-3)))
    turn = theta[held:] - theta[:-held]
    middle = theta[:-held] + 0.5 * turn
    chord = np.cos(middle) * (x[held:] - x[:-held]) + np.sin(middle) * (y[held:] - y[:-held])
    ahead = chord / np.clip(np.sinc(0.5 * turn / np.pi), 0.1, 1.0)  # the arc of a steady turn
    told = []
    for u in (left, right):
        turned = np.concatenate([[0.0], np.cumsum(u[:-1] * np.diff(t))])
        turned = np.interp(t - late, t, turned)
        told.append(turned[held:] - turned[:-held])
    return np.stack([ahead, turn, *told])


def _geometry(roles: Mapping[str, str], recordings: Sequence[Recording], clock: Clock) -> dict[str, float] | None:
    """Wheel radius and track width, m, with which an odometry computes its twist from the wheel speeds; None if it does
    not."""
    body, wheels = ("twist.x", "twist.y", "twist.theta", "pose.theta"), ("velocity.left", "velocity.right")
    if not {*body, *wheels} <= set(roles):
        return None
    parts = []
    for r in recordings:
        if not {roles[name] for name in (*body, *wheels)} <= set(r.columns):
            return None
        t = seconds(clock, r)
        twist = np.stack([r.columns[roles[name]] for name in body])
        there = np.isfinite(twist).all(axis=0) & np.isfinite(t)
        speeds = [_at(t[there], t, r.columns[roles[name]]) for name in wheels]
        parts.append(np.concatenate([twist[:, there], speeds]))
    x, y, yaw, theta, left, right = np.concatenate(parts, axis=1)
    radius, one = _slope(0.5 * (left + right), np.cos(theta) * x + np.sin(theta) * y)
    rate, other = _slope(right - left, yaw)
    if min(one, other) < SURE or radius <= 0.0 or rate <= 0.0:
        return None
    return {name: float(f"{value:.4g}") for name, value in zip(WHEELS, (radius, radius / rate), strict=True)}


def _at(when: np.ndarray, t: np.ndarray, values: np.ndarray) -> np.ndarray:
    """A column interpolated linearly at the times `when`; NaN if it has no samples."""
    there = np.isfinite(values) & np.isfinite(t)
    return np.interp(when, t[there], values[there]) if there.any() else np.full(len(when), np.nan)


def _slope(x: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """(slope through 0, uncentred correlation) of y on x, where both are finite."""
    there = np.isfinite(x) & np.isfinite(y)
    x, y = x[there], y[there]
    power = float(x @ x)
    if power == 0.0 or not np.any(y):
        return 0.0, 0.0
    return float(x @ y) / power, float(x @ y) / np.sqrt(power * float(y @ y))


def _refuse_empty(name: str, roles: Mapping[str, str], columns: Sequence[str], where: str) -> None:
    listed = ", ".join(columns[:30]) + (", ..." if len(columns) > 30 else "")
    commands = any(group(key) == "command" for key in roles)
    if not commands or not any(is_measured(key) for key in roles):
        what = "measurement" if commands else "command"
        raise BadInput(
            f"no column matches a {what} of {name}; the columns are {listed}",
            where,
            "log both commands and measurements, or write the robot file by hand with a [log] table",
        )


def _missing(wanted: Sequence[str], roles: Mapping[str, str]) -> tuple[Unmatched, ...]:
    driven = set(BODY) <= set(roles)
    turned = "pose.theta" if "pose.qw" in roles else ""
    absent = [k for k in wanted if k not in roles and k != turned and not (driven and group(k) == "command")]
    why = {"command": "no column matches, but every actuator needs a command", "pose": "no column matches"}
    return tuple(Unmatched(key, why[kind]) for key in absent if (kind := group(key)) in why)
