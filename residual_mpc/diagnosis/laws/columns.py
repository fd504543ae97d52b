"""Laws of logged columns that are worth a fit: what a temperature or a supply voltage changes in motors and joints."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import zip_longest

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.logged_columns import at_starts, foreknown_columns
from residual_mpc.diagnosis.laws.proposal import Proposal, proposal
from residual_mpc.diagnosis.laws.settings import LawSettings
from residual_mpc.diagnosis.laws.shapes import line, richer
from residual_mpc.effects.laws import CARRIERS, USUAL, Of, logged_kind
from residual_mpc.effects.library import BY_NAME
from residual_mpc.models import optional
from residual_mpc.models.protocol import Robot
from residual_mpc.models.settings import Knob


def of_columns(data: Dataset, first: str, settings: LawSettings) -> tuple[Proposal, ...]:
    """A law of each column that the runs foretell, for each effect that can carry one: on the actuator or joint that
    the column is named after, else on all alike and on the joint of the component `first`, which misses most.

    What the remainder depends on is not asked: the strength of a servo shows in proportion to its load, and as nothing
    where the load changes its sign.
    """
    robot = data.blocks[0].robot
    places = {column: list(_places(robot, column, first)) for column in foreknown_columns(data)}
    in_turn = [(c, p) for each in zip_longest(*places.values()) for c, p in zip(places, each, strict=True) if p]
    return tuple(_law(data, of, target, column, settings) for column, (of, target) in in_turn[: settings.columns])


def _law(data: Dataset, of: Of, target: str | None, column: str, settings: LawSettings) -> Proposal:
    kind, z = logged_kind(of, column), at_starts(data, column)
    shape = line(z)
    found = proposal(kind, target, shape, richer(kind, shape, z, settings))
    usual = {Knob(kind.name, target, USUAL): float(np.mean(z))}
    more = tuple(replace(r, fixed={**r.fixed, **usual}) for r in found.richer)
    return replace(found, fixed={**found.fixed, **usual}, richer=more)


def _places(robot: Robot, column: str, first: str) -> Iterator[tuple[Of, str | None]]:
    """What is missing, and its target (None: all alike), in the order in which they are tried."""
    joints = dict(zip(robot.actuators, optional.actuator_joints(robot), strict=True))
    named = column.rpartition(".")[2]
    for of, carrier in CARRIERS.items():
        slots = robot.slots(carrier.effect)
        if not slots:
            continue
        driven = BY_NAME[carrier.effect].target == "actuator"
        mine = {a for a, j in joints.items() if named in (a, j)} if driven else {joints.get(named, named)}
        here = [s for s in slots if s in mine]
        if here or len(slots) == 1:
            yield of, here[0] if here and len(slots) > 1 else None
            continue
        yield of, None
        of_first = first.removeprefix("position.")
        yield from ((of, s) for s in slots if (joints[s] if driven else s) == of_first)
