"""What the cases of every family are made on: its numbers, and one draw of a robot that effects are put into."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from plants.blind_families.planting import D, Plantings, R
from residual_mpc.blind.commanded_motion import CommandedMotion


@dataclass(frozen=True)
class Habits:
    """A family's numbers.

    unnamed: causes that no library names; those of test seeds are others, so that nothing is tuned on them. flaws: ways
    in which a model is wrong, each with the effects that describe a part of it; beyond: one that no effect describes.
    pairs: effects that are easily mistaken. changing: effects that may come and go. first: range of the strengths tried
    first; tries: of a strength; most: strength of a faint effect.
    """

    unnamed: tuple[str, ...]
    unnamed_in_tests: tuple[str, ...]
    flaws: Mapping[str, tuple[str, ...]]
    beyond: str
    pairs: tuple[tuple[str, str], ...]
    changing: tuple[str, ...]
    first: tuple[float, float]
    tries: int
    most: float


class Bench(Protocol[R, D]):
    """One draw of a family: a robot without any effect, the runs that it is to make, and how effects get into it."""

    @property
    def robot(self) -> R: ...

    @property
    def plantings(self) -> Plantings[R, D, Any]:
        """What the family knows of its effects."""
        ...

    @property
    def effects(self) -> tuple[str, ...]:
        """What is to be planted."""
        ...

    @property
    def flaws(self) -> tuple[str, ...]:
        """In which ways of its habits the model is to be wrong."""
        ...

    @property
    def always(self) -> tuple[str, ...]:
        """Causes without a name that every robot of the bench has."""
        ...

    @property
    def rest(self) -> float:
        """The gap over the noise floor that every robot of the bench has."""
        ...

    @property
    def described(self) -> tuple[str, ...]:
        """Effects that describe a part of what every robot of the bench has."""
        ...

    @property
    def traits(self) -> tuple[str, ...]:
        """What the runs are like, as the list of twins speaks of it."""
        ...

    @property
    def notes(self) -> Mapping[str, Any]: ...

    @property
    def habits(self) -> Habits:
        """The family's numbers."""
        ...

    def draw(self, effect: str, rng: np.random.Generator) -> D: ...

    def beside(self, draw: D, first: D) -> D:
        """The draw at the place of another one, so that the two are mistaken more easily."""
        ...

    def target(self, draw: D) -> str | None: ...

    def plant(self, robot: R, draw: D, strength: float) -> tuple[R, dict[str, float]]:
        """The robot that has the effect as well, and the effect's parameters."""
        ...

    def ratio(self, robot: R, horizon: float | None = None) -> float:
        """What the robot's effects add to the gap, over the noise floor; horizon: s, else the runs' own."""
        ...

    def left(self, robot: R) -> Callable[[R], tuple[float, float]]:
        """Of another robot as the model: the gap that it leaves, over the noise floor and as it is."""
        ...

    def unnamed(self, cause: str, rng: np.random.Generator) -> Callable[[float], R]:
        """The robot by the strength of a cause that no library names."""
        ...

    def flawed(self, rng: np.random.Generator) -> Callable[[float], tuple[R, R]]:
        """By the strength of the flaws of its model: the robot, and the robot with what nothing describes alone."""
        ...

    def changing(self, draw: D, rng: np.random.Generator) -> tuple[str, Callable[[float], R]]:
        """How an effect comes and goes, in words, and the robot by its strength."""
        ...

    def write(self, robot: R, clean: bool, rng: np.random.Generator, folder: Path) -> bool:
        """Write robot file, model and runs, with ``clean`` the noise-free runs beside the folder as well.

        False, and nothing written, where the robot runs away.
        """
        ...

    def play(self, robot: R, motion: CommandedMotion, rng: np.random.Generator, name: str, folder: Path) -> bool:
        """Write the run ``name`` that the robot logs when it is told to drive ``motion``; as ``write`` otherwise."""
        ...
