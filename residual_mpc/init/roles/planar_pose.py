"""The planar pose of a robot that drives, among the columns."""

from __future__ import annotations

from collections.abc import Mapping
from math import pi

import numpy as np

from residual_mpc.init.columns.evidence import Roles
from residual_mpc.init.columns.guess import Guess, LogCorrection
from residual_mpc.init.columns.signals import Signals
from residual_mpc.init.columns.words import ColumnName, tokens

PLACES = frozenset(
    "pose pos position odom odometry base robot world map amcl mocap vicon optitrack orientation link chassis body"
    " local global footprint gps slam lidar rtk ground truth gt".split()
)
HEADINGS = frozenset("theta yaw heading psi phi".split())
MOTIONS = frozenset("twist vel velocity linear angular imu gyro rate".split())
IN_ITS_FRAME = "is in the robot's frame by ROS convention; the log format needs the world frame"
SMALL_UNITS = {"mm": 1e-3, "cm": 1e-2}  # m
QUATERNION = "the heading is known already"
TURN, PARTS = frozenset("orientation quaternion quat".split()), ("x", "y", "z", "w")


def find_pose(words: Mapping[str, ColumnName], signals: Signals) -> tuple[Roles, dict[str, str]]:
    """Roles of pose.* and twist.*, and why columns that look like them were left."""
    found: dict[str, list[tuple[float, str]]] = {}
    left: dict[str, str] = {}
    for name in words:
        role, score, why = _role(words[name])
        if why:
            left[name] = why
        elif role and signals.moves(name):
            found.setdefault(role, []).append((score, name))
    columns, guesses = {}, []
    for role, choices in found.items():
        choices.sort(key=lambda c: -c[0])
        best, name = choices[0]
        rivals = tuple(n for s, n in choices[1:] if s > best - 0.5)
        columns[role] = name
        guesses.append(Guess(role, name, "its name", 0.5 if rivals else 0.9, rivals))
    if "pose.theta" not in columns and "pose.x" in columns:
        turned = _quaternion(words, signals, columns["pose.x"])
        columns |= {g.what: g.value for g in turned}
        guesses += turned
    return Roles(columns, tuple(guesses)), {n: why for n, why in left.items() if n not in columns.values()}


def _quaternion(words: Mapping[str, ColumnName], signals: Signals, place: str) -> list[Guess]:
    """The four columns of an orientation, of the topic that names the place where there are several; empty without."""
    found: dict[tuple[str, ...], dict[str, str]] = {}
    for name, said in words.items():
        head, axis = said.every[:-1], said.every[-1:]
        if set(axis) & set(PARTS) and TURN & set(head) and not said.commanded:
            found.setdefault(head, {})[axis[0]] = name
    whole = {head: parts for head, parts in found.items() if set(parts) == set(PARTS) and signals.moves(parts["z"])}
    if not whole:
        return []
    near = words[place].every
    best = max(whole, key=lambda h: sum(w in near for w in h) - 0.1 * len(h))
    why = "a part of an orientation, from which the heading is computed"
    return [Guess(f"pose.q{a}", whole[best][a], why, 0.9 if len(whole) == 1 else 0.7) for a in PARTS]


def heading_in_degrees(signals: Signals, roles: Roles) -> tuple[LogCorrection, ...]:
    """A heading that goes beyond a turn in radians and stays within one in degrees, or is called so."""
    column = roles.columns.get("pose.theta")
    if column is None:
        return ()
    x = signals.raw[column]
    said = any(w in column.lower() for w in ("deg",))
    largest, step = float(np.nanmax(np.abs(x))), float(np.nanmax(np.abs(np.diff(x[np.isfinite(x)]))))
    if said or 4.0 * pi < largest <= 400.0 and step > 0.0:
        why = f"a heading of {largest:.4g} must be in degrees" + (", and the name says so" if said else "")
        return (LogCorrection(column, pi / 180.0, 0.0, why, 0.98 if said else 0.8),)
    return ()


def places_in_small_units(signals: Signals, roles: Roles) -> tuple[LogCorrection, ...]:
    """Places whose names say millimetres or centimetres."""
    out = []
    for role in ("pose.x", "pose.y"):
        column = roles.columns.get(role)
        unit = next((u for u in SMALL_UNITS if column is not None and u in tokens(column)), None)
        if column is not None and unit is not None and signals.moves(column):
            out.append(LogCorrection(column, SMALL_UNITS[unit], 0.0, f"its name says {unit}", 0.95))
    return tuple(out)


def pose_role(words: ColumnName) -> str | None:
    """The role of pose.* or twist.* that a column's name is like, None where it is like none."""
    return _role(words)[0]


def _role(words: ColumnName) -> tuple[str | None, float, str]:
    """(role or None, score, why the column is left although it looks like one)."""
    every = set(words.every)
    if words.commanded or words.quantity in ("other", "enabled", "effort", "acceleration"):
        return None, 0.0, ""
    if TURN & every and set(PARTS) & every:
        return None, 0.0, QUATERNION
    if {"linear", "vx", "vy"} & every:
        return None, 0.0, IN_ITS_FRAME
    known = every & (PLACES | MOTIONS)
    axis = next((a for a in ("x", "y") if a in every), None) or ("theta" if every & HEADINGS else None)
    rest = every - PLACES - MOTIONS - HEADINGS - {"x", "y", "z", "m", "mm", "cm", "rad", "deg", "d", "rate", "wz", "w"}
    score = 1.0 + 0.5 * len(known) - 1.5 * len(rest)
    if "wz" in every or every & MOTIONS and (axis == "theta" or {"angular", "z"} <= every or {"gyro", "z"} <= every):
        return ("twist.theta", score, "") if score > 0.0 else (None, 0.0, "")
    if axis is None or every & MOTIONS or score <= 0.0:
        twist = axis is not None and "twist" in every and score > 0.0
        return (f"twist.{axis}", score, "") if twist else (None, 0.0, "")
    return f"pose.{axis}", score, ""
