"""Joints that no column commands: driven by what was measured, held, coupled to another joint, or passive."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from residual_mpc.init.columns.evidence import ColumnEvidence, JointDrive, Roles
from residual_mpc.init.columns.guess import Guess

STILL = 0.03  # share of its range (rad or m where it has none) within which a joint counts as standing still


@dataclass(frozen=True)
class Uncommanded:
    """held: names for the robot file, each with its guess; passive: joints that move and have no motor, as far as the
    log says; lacking: actuators of which a command is needed and none was found."""

    held: tuple[str, ...]
    guesses: tuple[Guess, ...]
    passive: tuple[JointDrive, ...]
    lacking: tuple[JointDrive, ...]


def driven_by_measurement(case: ColumnEvidence, roles: Roles) -> Roles:
    """Velocity actuators without a command column are driven by the velocity that was measured."""
    velocities = roles.of("velocity")
    lacking = [d for d in _without_command(case, roles) if d.kind == "velocity" and d.joint in velocities]
    why = "it has no command; the measured velocity drives the model and is not compared"
    columns = {f"command.{d.name}": velocities[d.joint] for d in lacking}
    return roles.plus(Roles(columns, tuple(Guess(name, c, why, 0.7) for name, c in columns.items())))


def find_uncommanded(case: ColumnEvidence, roles: Roles) -> Uncommanded:
    """What becomes of the joints that no column commands; `roles` with the measurements that drive."""
    follows = {j.name for j in case.structure.joints if j.follows is not None}
    held: list[JointDrive] = []
    passive: list[JointDrive] = []
    lacking: list[JointDrive] = []
    for d in _without_command(case, roles):
        if d.joint in follows and d.kind is None:
            continue
        if _stands(case, roles, d) and not _may_be_wheel(case, d):
            held.append(d)
        else:
            (passive if d.kind is None else lacking).append(d)
    if not roles.of("command"):
        return Uncommanded((), (), tuple(passive), tuple(lacking))
    names = tuple(d.name for d in held)
    return Uncommanded(names, _guess(names), tuple(passive), tuple(lacking))


def _guess(names: Sequence[str]) -> tuple[Guess, ...]:
    if not names:
        return ()
    why = "no column commands it and it does not move in the log: it stays where it is"
    return (Guess("held", ", ".join(names), why if len(names) == 1 else why.replace("it", "each", 1), 0.7),)


def _without_command(case: ColumnEvidence, roles: Roles) -> list[JointDrive]:
    return [d for d in case.driven if f"command.{d.name}" not in roles.columns]


def _may_be_wheel(case: ColumnEvidence, driven: JointDrive) -> bool:
    """A wheel turns without a column: of a robot that drives only what is servoed to a position is held."""
    return driven.kind == "velocity" or (case.structure.base is not None and driven.kind != "position")


def _stands(case: ColumnEvidence, roles: Roles, driven: JointDrive) -> bool:
    """Whether the joint is not seen to move: its position hardly changes, or nothing measures it."""
    column = roles.of("position").get(driven.joint)
    if column is None:
        return driven.joint not in roles.of("velocity")
    limits = next(j.limits for j in case.structure.joints if j.name == driven.joint)
    low, high = limits or (0.0, 1.0)
    seen = case.signals.raw[column]
    span = float(np.ptp(np.nanquantile(seen, (0.01, 0.99))))
    unit = 180.0 / np.pi if span > high - low else 1.0  # degrees, as far as that matters here
    return span < STILL * unit * (high - low)
