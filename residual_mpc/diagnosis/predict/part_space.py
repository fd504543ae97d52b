"""Hypotheses in which some effects act in a part of the runs alone."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace

from residual_mpc.diagnosis.predict.space import Space
from residual_mpc.models.settings import Settings, Term, Values


@dataclass(frozen=True)
class PartSpace(Space):
    """partly: the terms that do nothing on the windows outside a part (`Block.later`, see `data.parts`)."""

    partly: frozenset[Term] = field(default=frozenset(), kw_only=True)

    def settings(self, hypotheses: Sequence[Values]) -> Settings:
        """One row per hypothesis, with the values outside the part beside those in it."""
        return in_and_outside(hypotheses, self.partly, super().settings)


def in_and_outside(
    hypotheses: Sequence[Values], partly: frozenset[Term], settings: Callable[[Sequence[Values]], Settings]
) -> Settings:
    """The settings of hypotheses of which these terms do nothing outside a part of the runs."""
    inside = settings(hypotheses)
    rest = [{k: v for k, v in h.items() if k.term not in partly} for h in hypotheses]
    if all(len(r) == len(h) for r, h in zip(rest, hypotheses, strict=True)):
        return inside
    return replace(inside, later=settings(rest))


def part_space(space: Space, partly: frozenset[Term]) -> PartSpace:
    """The same hypotheses, of which these terms act in a part of the runs alone."""
    return PartSpace(**{f.name: getattr(space, f.name) for f in fields(Space)}, partly=partly)
