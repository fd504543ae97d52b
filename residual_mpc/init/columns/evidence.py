"""What the columns of a log are weighed by, and which of them were given a role so far."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from residual_mpc.init.columns.guess import Guess
from residual_mpc.init.columns.name_matching import Members, members_of
from residual_mpc.init.columns.signals import NOTHING, SignalMatch, Signals
from residual_mpc.init.columns.words import ColumnName, Quantity
from residual_mpc.logs.audit.facts import ActuatorFacts
from residual_mpc.models.model_structure import ModelStructure


@dataclass(frozen=True)
class JointDrive:
    """What drives a joint: an actuator of the model, or one that its file does not declare, whose kind is None. gear:
    of a servo, its command over the joint's position or velocity. share: whether its command is a share of a torque."""

    name: str
    joint: str
    kind: Quantity | None
    gear: float = 1.0
    share: bool = False


@dataclass(frozen=True, eq=False)
class ColumnEvidence:
    """All that the columns are weighed by."""

    structure: ModelStructure
    signals: Signals
    words: Mapping[str, ColumnName]

    @cached_property
    def driven(self) -> tuple[JointDrive, ...]:
        if self.structure.actuators:
            return tuple(_driven(a) for a in self.structure.actuators)
        return tuple(JointDrive(j.name, j.name, None) for j in self.structure.joints)

    @cached_property
    def joints(self) -> Members:
        """The joints, by their own names and by those of their actuators."""
        aliases = [
            (j.name, *(d.name for d in self.driven if d.joint == j.name and d.name != j.name))
            for j in self.structure.joints
        ]
        return members_of(aliases, tuple(self.words.values()))

    @cached_property
    def actuators(self) -> Members:
        """The actuators, by their own names and by those of their joints."""
        return members_of([tuple(dict.fromkeys((d.name, d.joint))) for d in self.driven], tuple(self.words.values()))

    @cached_property
    def moving(self) -> tuple[str, ...]:
        return tuple(n for n in self.words if self.signals.moves(n))


@dataclass(frozen=True)
class Roles:
    """columns: log name -> column. guesses: one a role."""

    columns: Mapping[str, str]
    guesses: tuple[Guess, ...] = ()

    def of(self, group: str) -> dict[str, str]:
        """Member -> column of a group such as `position`."""
        return {n.partition(".")[2]: c for n, c in self.columns.items() if n.partition(".")[0] == group}

    def plus(self, other: Roles) -> Roles:
        return Roles({**self.columns, **other.columns}, (*self.guesses, *other.guesses))


def where_on(case: ColumnEvidence, roles: Roles) -> ColumnEvidence:
    """The case where every actuator is switched on: elsewhere no command is followed."""
    on = np.ones(len(case.signals.run), dtype=bool)
    for column in roles.of("enabled").values():
        on &= ~(case.signals.raw[column] < 0.5)
    if on.all() or not on.any():
        return case
    raw = {name: np.where(on, x, np.nan) for name, x in case.signals.raw.items()}
    return replace(case, signals=Signals(case.signals.dt, raw, case.signals.run, case.signals.whole))


def _driven(actuator: ActuatorFacts) -> JointDrive:
    kinds: Mapping[str, Quantity] = {"position": "position", "velocity": "velocity", "torque": "effort"}
    joint = actuator.joint or actuator.name
    return JointDrive(actuator.name, joint, kinds[actuator.kind], actuator.gear, actuator.share)


def joint_response(case: ColumnEvidence, roles: Roles, column: str, driven: JointDrive) -> tuple[SignalMatch, str]:
    """How the joint answers a column that may be its command, over the gear, and the column by which it was seen."""
    position, velocity = (roles.of(g).get(driven.joint) for g in ("position", "velocity"))
    seen: list[tuple[SignalMatch, str]] = []
    s = case.signals
    if driven.kind in (None, "position") and position:
        seen.append((s.follows(column, position), position))
    if driven.kind in (None, "velocity"):
        if velocity:
            seen.append((s.follows(column, velocity, levels=True), velocity))
        if position:
            seen.append((s.follows(column, position, answer_rate=True, levels=True), f"the derivative of {position}"))
    answer, by = max(seen, key=lambda x: abs(x[0].correlation), default=(NOTHING, ""))
    return (answer if driven.gear == 1.0 else answer.per(driven.gear)), by
