"""What is changed in one case, drawn from its seed. Development and test seeds draw different combinations, targets
and sizes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import TypeVar
from zlib import crc32

import numpy as np

from residual_mpc.blind.recorded.kinds.kind import Kind, Sizes, Target
from residual_mpc.blind.recorded.sizing import Sizer
from residual_mpc.blind.records import Planted
from residual_mpc.errors import BadInput

DOSES = 5  # steps from barely visible to large
NUMBERS = (1, 0, 1, 2, 3)  # changes in a case: the shares in which they come
T = TypeVar("T")
Carried = Sequence[tuple[Kind, tuple[Target, ...]]]


@dataclass(frozen=True)
class Recipe:
    """One case to be made. lead: place of its first kind among those that the runs can carry; dose: its step, from 1;
    number: of changes."""

    name: str
    seed: int
    number: int
    lead: int
    dose: int
    test: bool


@dataclass(frozen=True)
class Change:
    """One drawn change. dose: its step, from 1; visibility: see `visibility`, NaN for a kind without one."""

    kind: Kind
    target: Target
    sizes: Sizes
    dose: int
    visibility: float

    @property
    def planted(self) -> Planted:
        """As an answer states it."""
        return Planted(self.kind.effect, self.target, dict(self.sizes))


def plan(robot: str, cases: int, first_seed: int, test: bool) -> list[Recipe]:
    """The recipes of a robot's suite. Numbers, kinds and doses come evenly, in an order that says nothing of them."""
    rng = np.random.default_rng([first_seed, cases, crc32(robot.encode())])
    numbers = [NUMBERS[i % len(NUMBERS)] for i in range(cases)]
    first = int(rng.integers(1000))
    recipes = []
    for place, i in enumerate(rng.permutation(cases).tolist()):
        turn = numbers[:i].count(numbers[i])  # among the cases with as many changes
        # a kind that comes again comes with another dose
        dose = 1 + (2 * turn + turn // DOSES) % DOSES
        recipes.append(Recipe(f"case-{place + 1:04d}", first_seed + place, numbers[i], first + turn, dose, test))
    return recipes


def draw(carried: Carried, recipe: Recipe, rng: np.random.Generator, size: Sizer) -> tuple[Change, ...]:
    """The changes of a case, in the order in which they are put in. Changes that are not visible even at their largest
    size are not drawn.

    Raises BadInput if no kind is visible in these runs.
    """
    if not recipe.number:
        return ()
    left = carried
    while left:
        changes = list[Change]()
        for place, (kind, targets) in enumerate(_kinds(left, recipe, rng)):
            dose = recipe.dose if place == 0 else int(rng.integers(1, DOSES + 1))
            target = _one(targets, kind.effect, recipe.test, rng)
            # within a step, development and test seeds draw from parts that do not touch
            part = rng.uniform(0.55, 0.95) if recipe.test else rng.uniform(0.05, 0.45)
            sized = size(kind, target, (dose - 1 + part) / DOSES, rng)
            if sized is None:
                left = _without(left, kind, target)
                break
            changes.append(Change(kind, target, sized.sizes, dose, sized.visibility))
        else:
            return tuple(sorted(changes, key=lambda change: change.kind.rank))
    raise BadInput(
        "these runs scatter so much that even the largest change of every kind is invisible", "--kind",
        "choose other kinds, or give more runs",
    )  # fmt: skip


def _without(carried: Carried, kind: Kind, target: Target) -> Carried:
    fewer = [(k, tuple(t for t in targets if (k, t) != (kind, target))) for k, targets in carried]
    return [(k, targets) for k, targets in fewer if targets]


def _kinds(carried: Carried, recipe: Recipe, rng: np.random.Generator) -> list[tuple[Kind, tuple[Target, ...]]]:
    lead = carried[recipe.lead % len(carried)]
    for number in range(recipe.number, 1, -1):
        others = [entry for entry in carried if entry[0].family != lead[0].family]
        sets = [s for s in combinations(others, number - 1) if len({k.family for k, _ in s}) == number - 1]
        if sets:
            fitting = _side(sets, lambda s: "+".join(sorted(k.effect for k, _ in (lead, *s))), recipe.test)
            return [lead, *fitting[int(rng.integers(len(fitting)))]]
    return [lead]


def _one(targets: tuple[Target, ...], effect: str, test: bool, rng: np.random.Generator) -> Target:
    fitting = _side(targets, lambda t: f"{effect} {t}", test)
    return fitting[int(rng.integers(len(fitting)))]


def _side(items: Sequence[T], name: object, test: bool) -> list[T]:
    """The items that belong to test seeds, or to development seeds; all where one side has none."""
    assert callable(name)
    sides = [bool(crc32(name(item).encode()) % 2) for item in items]
    return [item for item, side in zip(items, sides, strict=True) if side == test or len(set(sides)) == 1]
