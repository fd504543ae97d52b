"""From a level to a case, whatever the family: plant effects at their strengths, write the files, keep the answer."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, Protocol

import numpy as np

from plants.blind_families.planting import D, P, Plantings, R, background, clash
from plants.blind_families.strength import tuned
from residual_mpc.blind.commanded_motion import CommandedMotion
from residual_mpc.blind.inseparable import may_be_withheld
from residual_mpc.blind.levels import Level
from residual_mpc.blind.records import Answer, Planted
from residual_mpc.effects.equivalents import inseparable_from

STRONG = 7.0  # ratio to the noise floor of a usual strong effect
SHOWN = (2.5, 18.0)  # least and most ratio of what is planted


@dataclass(frozen=True)
class Habits:
    """A family's numbers. unnamed: causes that no library names; first: range of the strengths tried first; tries: of
    a strength; most: strength of a faint effect.
    """

    unnamed: tuple[str, ...]
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

    def target(self, draw: D) -> str | None: ...

    def plant(self, robot: R, draw: D, strength: float) -> tuple[R, dict[str, float]]:
        """The robot that has the effect as well, and the effect's parameters."""
        ...

    def ratio(self, robot: R) -> float:
        """What the robot's effects add to the gap, over the noise floor."""
        ...

    def unnamed(self, cause: str, rng: np.random.Generator) -> Callable[[float], R]:
        """The robot by the strength of a cause that no library names."""
        ...

    def write(self, robot: R, clean: bool, rng: np.random.Generator, folder: Path) -> bool:
        """Write robot file, model and runs, with ``clean`` the noise-free runs beside the folder as well.

        False, and nothing written, where the robot runs away.
        """
        ...

    def play(self, robot: R, motion: CommandedMotion, rng: np.random.Generator, name: str, folder: Path) -> bool:
        """Write the run ``name`` that the robot logs when it is told to drive ``motion``; as ``write`` otherwise."""
        ...


@dataclass(frozen=True)
class Drawn(Generic[R, D]):
    """A case that is drawn and written: its answer, and the robot that made its runs on this bench."""

    answer: Answer
    bench: Bench[R, D]
    robot: R

    def play(self, motion: CommandedMotion, rng: np.random.Generator, name: str, folder: Path) -> bool:
        """See ``families.Twin``."""
        return self.bench.play(self.robot, motion, rng, name, folder)


def choose(plantings: Plantings[R, D, P], level: Level, rng: np.random.Generator) -> tuple[str, ...]:
    """As many effects as the level wants, none of which hides or undoes another."""
    names = sorted(plantings)
    while True:
        count = int(rng.integers(level.effects[0], level.effects[1] + 1))
        chosen = tuple(str(n) for n in rng.choice(names, count, replace=False))
        if not clash(plantings, chosen):
            return chosen


def first_case(attempt: Callable[[], Drawn[R, D] | None], attempts: int, what: str) -> Drawn[R, D]:
    """The first draw that makes a case; ``RuntimeError`` where none of ``attempts`` does."""
    for _ in range(attempts):
        drawn = attempt()
        if drawn is not None:
            return drawn
    raise RuntimeError(f"no {what} in {attempts} draws")


def make(
    family: str, bench: Bench[R, D], level: Level, seed: int, rng: np.random.Generator, folder: Path
) -> Drawn[R, D] | None:
    """Plant what the level wants, write what a user would have, and return what was drawn.

    None where these runs cannot show it, or the robot runs away.
    """
    if level.withheld and not may_be_withheld(bench.effects[0], bench.traits):
        return None
    planted = _plant_all(bench, rng)
    if planted is None:
        return None
    robot, faint = _plant_background(bench, level, rng)
    for draw, strength, _ in planted:
        robot, _ = bench.plant(robot, draw, strength)
    unknown: tuple[str, ...] = ()
    if level.unknown:
        unknown = (str(rng.choice(bench.habits.unnamed)),)
        found = _plant_unnamed(bench, unknown[0], rng)
        if found is None:
            return None
        robot = found
    if not bench.write(robot, bool(planted), rng, folder):
        return None
    answer = Answer(
        case=f"{family}-{level.name}-{seed}",
        family=family,
        level=level.name,
        seed=seed,
        effects=tuple(p for _, _, p in planted),
        background=faint,
        unknown=unknown,
        withheld=bench.effects if level.withheld else (),
        twins=tuple(inseparable_from(p.effect, bench.traits) for _, _, p in planted),
        traits=bench.traits,
        notes={"ratio": bench.ratio(robot), **bench.notes},
    )
    return Drawn(answer, bench, robot)


def _plant_all(bench: Bench[R, D], rng: np.random.Generator) -> list[tuple[D, float, Planted]] | None:
    """(draw, strength, effect) of each; None where these runs cannot show one."""
    planted = []
    for effect in bench.effects:
        draw = bench.draw(effect, rng)
        wanted = float(np.exp(rng.uniform(np.log(3.5), np.log(13))))
        one = _plant_one(bench, effect, draw, wanted, float(rng.uniform(*bench.habits.first)))
        if one is None:
            return None
        planted.append((draw, *one))
    return planted


def _plant_one(bench: Bench[R, D], effect: str, draw: D, wanted: float, start: float) -> tuple[float, Planted] | None:
    """The strength that gives the wanted ratio and the effect at it."""
    if not bench.plantings[effect].tuned:
        strength, ratio = float(np.clip(wanted / 15, 0.15, 1.0)), wanted
    else:
        strength, ratio = tuned(
            lambda s: bench.ratio(bench.plant(bench.robot, draw, s)[0]), wanted, start, bench.habits.tries
        )
        if not SHOWN[0] <= ratio <= SHOWN[1]:
            return None
    _, parameters = bench.plant(bench.robot, draw, strength)
    return strength, Planted(effect, bench.target(draw), parameters, ratio)


def _plant_background(bench: Bench[R, D], level: Level, rng: np.random.Generator) -> tuple[R, tuple[Planted, ...]]:
    """The robot with the faint effects of the level, each about its share of a strong one."""
    robot, planted = bench.robot, []
    for effect in background(bench.plantings, bench.effects) if level.background else ():
        draw = bench.draw(effect, rng)
        tried = 0.2 * bench.plantings[effect].typical
        shown_by_it = max(bench.ratio(bench.plant(bench.robot, draw, tried)[0]), 0.2)
        share = tried * level.background * STRONG * float(rng.uniform(0.5, 1.5)) / shown_by_it
        robot, parameters = bench.plant(robot, draw, min(share, bench.habits.most))
        planted.append(Planted(effect, bench.target(draw), parameters))
    return robot, tuple(planted)


def _plant_unnamed(bench: Bench[R, D], cause: str, rng: np.random.Generator) -> R | None:
    """The robot with the cause as strong as a strong effect; None where these runs cannot show it."""
    wanted = float(np.exp(rng.uniform(np.log(4), np.log(12))))
    caused = bench.unnamed(cause, rng)
    strength, ratio = tuned(lambda s: bench.ratio(caused(s)), wanted, tries=bench.habits.tries)
    return caused(strength) if SHOWN[0] <= ratio <= SHOWN[1] else None
