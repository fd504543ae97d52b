"""Draft a robot file for a built-in robot such as `diff_drive`, whose channels are known and matched to the log's."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from residual_mpc.errors import BadInput
from residual_mpc.init.columns.guess import Guess
from residual_mpc.init.columns.recording import Recording, column_words, read_recordings
from residual_mpc.init.columns.signals import Signals, gather
from residual_mpc.init.columns.time_column import Clock, find_clock, seconds
from residual_mpc.init.columns.words import ColumnName, core_of, likeness
from residual_mpc.init.draft import Draft, Unmatched, log_entries, run_guess
from residual_mpc.init.roles.planar_pose import find_pose
from residual_mpc.logs.columns import group, is_measured, member
from residual_mpc.models.load import load_robot
from residual_mpc.models.robot_file import WHEELS, RobotFile

ALIKE = 0.9  # likeness of a column's words to an actuator's or a joint's name
BODY = ("command.linear", "command.angular")
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
    guesses = [guess for key in wanted if (guess := _column(key, signals, words, known)) is not None]
    nominal = model.nominal()
    if set(WHEELS) <= set(nominal) and not any(g.what.startswith("command.") for g in guesses):
        guesses += [Guess(k, known[k], "a body velocity, which the wheels' geometry turns into wheel speeds", 0.9)
                    for k in BODY if set(BODY) <= set(known)]  # fmt: skip
    if not any(g.what.startswith("pose.") for g in guesses):
        taken = {g.value for g in guesses}
        found, _ = find_pose({n: w for n, w in words.items() if n not in taken}, signals)
        guesses += [g for g in found.guesses if g.what in wanted and g.what not in {h.what for h in guesses}]
    roles = {g.what: g.value for g in guesses}
    _refuse_empty(name, roles, signals.names, str(recordings[0].source))
    parameters, reasons = _parameters(nominal, roles, recordings, clock)
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
        clock.mends,
        tuple(Unmatched(n, f"{name} has nothing of this kind") for n in signals.names if n not in roles.values()),
        _missing(wanted, roles),
        tuple(dict.fromkeys(note for r in recordings for note in r.notes)),
        parameters,
    )


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
    likely = {n: likeness(w.core, core) for n, w in words.items() if _is_kind(w, kind)}
    best = [n for n, alike in likely.items() if alike >= ALIKE and alike == max(likely.values())]
    if not best:
        return None
    why = f"its name resembles {member(key)} and says {kind}"
    return Guess(key, best[0], why, 0.5 if len(best) > 1 else 0.85, tuple(best[1:]))


def _is_kind(words: ColumnName, kind: str) -> bool:
    if kind == "command":
        return words.commanded and words.quantity in (None, "velocity")
    return words.quantity == kind and not words.commanded


def _parameters(
    nominal: Mapping[str, float], roles: Mapping[str, str], recordings: Sequence[Recording], clock: Clock
) -> tuple[dict[str, float], list[Guess]]:
    """The nominal parameters, estimated from the odometry if it was computed from the wheel speeds of the log."""
    told = _geometry(roles, recordings, clock) if set(WHEELS) == set(nominal) else None
    if told is not None:
        why = "least squares of the odometry's own speed on the wheel speeds; check it against the robot"
        return told, [Guess(f"parameters.{k}", f"{v:.6g}", why, 0.8) for k, v in told.items()]
    why = "the built-in robot's value: write that of your robot"
    return dict(nominal), [Guess(f"parameters.{k}", f"{v:.6g}", why, 0.1) for k, v in nominal.items()]


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
    absent = [key for key in wanted if key not in roles and not (driven and group(key) == "command")]
    why = {"command": "no column matches, but every actuator needs a command", "pose": "no column matches"}
    return tuple(Unmatched(key, why[kind]) for key in absent if (kind := group(key)) in why)
