"""Hypotheses in which effects have another size in some groups of windows, or do nothing there."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace

import numpy as np

from residual_mpc.diagnosis.predict.space import Space
from residual_mpc.effects.library import BY_NAME
from residual_mpc.models.settings import Knob, Settings, Term, Values
from residual_mpc.models.size_numbers import size_knobs

Bounds = Callable[[Knob], tuple[float, float]]
Sizes = Mapping[Term, float]  # of a group: the factor on the size of each term that is listed; with 0 it does nothing


@dataclass(frozen=True)
class GroupSpace(Space):
    """groups: the sizes in the groups 1, 2, ... of windows (see `Block`)."""

    groups: tuple[Sizes, ...] = field(default=(), kw_only=True)

    def settings(self, hypotheses: Sequence[Values]) -> Settings:
        """One row per hypothesis, with the values in each group."""
        return in_groups(hypotheses, self.groups, super().settings, self.bounds)


def group_space(space: Space, groups: Sequence[Sizes]) -> GroupSpace:
    """The same hypotheses, with these sizes in the groups."""
    return GroupSpace(**{f.name: getattr(space, f.name) for f in fields(Space)}, groups=tuple(groups))


def in_groups(
    hypotheses: Sequence[Values],
    groups: Sequence[Sizes],
    settings: Callable[[Sequence[Values]], Settings],
    bounds: Bounds,
) -> Settings:
    """The settings of hypotheses whose terms have these sizes in the groups."""
    here = settings(hypotheses)
    listed = {t for sizes in groups for t in sizes}
    if not any(k.term in listed for h in hypotheses for k in h):
        return here
    return replace(here, others=tuple(settings([sized(h, sizes, bounds) for h in hypotheses]) for sizes in groups))


def sized(values: Values, sizes: Sizes, bounds: Bounds) -> Values:
    """The values with other sizes of some terms, within the bounds of their numbers."""
    out: Values = {k: v for k, v in values.items() if sizes.get(k.term) != 0.0}
    for term, factor in sizes.items():
        if factor not in (0.0, 1.0):
            out = resized(out, term, factor, bounds)
    return out


def resized(values: Values, term: Term, factor: float, bounds: Bounds) -> Values:
    """The values with the size of one effect multiplied by a factor, within the bounds of its numbers."""
    new = {k: zero_of(k) + (values[k] - zero_of(k)) * factor for k in size_knobs(values, term)}
    return {**values, **{k: float(np.clip(v, *bounds(k))) for k, v in new.items()}}


def zero_of(knob: Knob) -> float:
    """From where the size of an effect counts: where it does nothing; 0 for a limit or a stiffness."""
    null = BY_NAME[knob.effect].parameter(knob.parameter).null
    return null if np.isfinite(null) else 0.0
