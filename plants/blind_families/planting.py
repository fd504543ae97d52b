"""What a family knows of an effect that it plants into its robots: one record for each effect.

Of the library it takes what an effect is called and where it acts, never an equation: the truths have their own.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Generic, TypeVar

from residual_mpc.effects.effect import Effect

R = TypeVar("R")  # a family's robot: truth and sensors
D = TypeVar("D")  # what a family draws once for an effect
P = TypeVar("P")  # draws the place of an effect


class Faint(Enum):
    """Beside which strong effects an effect may stand in the background."""

    ANY = "any"
    NO_CLASH = "those that it does not clash with"
    NONE = "none"


@dataclass(frozen=True)
class Confounded:
    """How a case is made that fits two effects equally well.

    straight: on straight lines only. by: the effect that is planted to stand for both; None: the record's own.
    """

    straight: bool = False
    by: Effect | None = None


@dataclass(frozen=True)
class Planting(Generic[R, D, P]):
    """One effect of a family.

    plant: the robot that has the effect as well, at a strength from 0 to 1, and the effect's parameters.
    place: draws where it sits.
    typical: share of full strength that is typical of a strong case; a tenth of it is a faint background.
    clashes: groups of which a case holds one member at most, since data could hardly tell two apart, or one undoes the
    other.
    tuned: whether the gap shows it, so that its strength is tuned to a ratio.
    needs: what it needs of the runs, in the family's words.
    confounded: None where no case of that level is made of it.
    """

    effect: Effect
    plant: Callable[[R, D, float], tuple[R, dict[str, float]]]
    place: P
    typical: float
    clashes: tuple[str, ...] = ()
    faint: Faint = Faint.ANY
    tuned: bool = True
    needs: tuple[str, ...] = ()
    confounded: Confounded | None = None


Plantings = Mapping[str, Planting[R, D, P]]  # by the effect's name


def by_name(*plantings: Planting[R, D, P]) -> Plantings[R, D, P]:
    """The records by their effects' names, in the order given."""
    return {p.effect.name: p for p in plantings}


def clash(plantings: Plantings[R, D, P], effects: tuple[str, ...]) -> bool:
    """Whether two of the effects are in one group."""
    groups = [group for effect in effects for group in plantings[effect].clashes]
    return len(set(groups)) < len(groups)


def background(plantings: Plantings[R, D, P], effects: tuple[str, ...]) -> tuple[str, ...]:
    """What may stand in the background of these strong effects, sorted: the order of drawing."""

    def stands_beside(name: str) -> bool:
        rule = plantings[name].faint
        return rule is Faint.ANY or (rule is Faint.NO_CLASH and not clash(plantings, (name, *effects)))

    return tuple(name for name in sorted(set(plantings) - set(effects)) if stands_beside(name))


def confounded(plantings: Plantings[R, D, P]) -> dict[str, Confounded]:
    """The effects of which a confounded case can be made, in the order of the records: the draws depend on it."""
    return {name: p.confounded for name, p in plantings.items() if p.confounded is not None}


def needed(plantings: Plantings[R, D, P], effects: tuple[str, ...], need: str) -> bool:
    """Whether one of the effects needs this of the runs."""
    return any(need in plantings[effect].needs for effect in effects)
