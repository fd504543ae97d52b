"""From a level to a case, whatever the family: choose what to hide, write the files, keep the answer."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Generic

import numpy as np

from plants.blind_families.bench import Bench, Habits
from plants.blind_families.hide import hide
from plants.blind_families.planting import D, P, Plantings, R, clash
from residual_mpc.blind.commanded_motion import CommandedMotion
from residual_mpc.blind.inseparable import may_be_withheld
from residual_mpc.blind.levels import Level
from residual_mpc.blind.records import Answer, Planted
from residual_mpc.effects.equivalents import inseparable_from


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


def choose_for(
    plantings: Plantings[R, D, P], habits: Habits, level: Level, rng: np.random.Generator
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """What the level wants: (effects, flaws of the model)."""
    if level.pairs:
        return habits.pairs[rng.integers(len(habits.pairs))], ()
    if level.changed:
        return (str(rng.choice(habits.changing)),), ()
    if not level.misspecified:
        return choose(plantings, level, rng), ()
    flaw = str(rng.choice(sorted(habits.flaws)))
    plain = {name: p for name, p in plantings.items() if name not in habits.flaws[flaw] and p.tuned}
    return choose(plain, level, rng), (flaw, habits.beyond)


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
    """Hide what the level wants, write what a user would have, and return what was drawn.

    None where these runs cannot show it, or the robot runs away.
    """
    if level.withheld and not may_be_withheld(bench.effects[0], bench.traits):
        return None
    hidden = hide(bench, level, seed, rng)
    if hidden is None:
        return None
    unknown = (*hidden.unknown, *bench.always)
    # beside a flaw the best fit would be the flaw's as well: there the constants as drawn are the truth
    clean = bool(hidden.effects) and not unknown
    if not bench.write(hidden.robot, clean, rng, folder):
        return None
    there = hidden.effects or tuple(p for p in hidden.background if hidden.unknown)
    planted = {p.effect for p in hidden.effects}
    answer = Answer(
        case=f"{family}-{level.name}-{seed}",
        family=family,
        level=level.name,
        seed=seed,
        effects=hidden.effects,
        background=(*hidden.background, *(Planted(name, None, {}) for name in bench.described if name not in planted)),
        unknown=unknown,
        withheld=bench.effects if level.withheld else (),
        twins=tuple(inseparable_from(p.effect, bench.traits) for p in there),
        traits=bench.traits,
        notes={"ratio": bench.ratio(hidden.robot), **hidden.notes, **bench.notes},
    )
    return Drawn(answer, bench, hidden.robot)
