"""Hypotheses in which effects have another size in some groups of windows, or do nothing there."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace

import numpy as np

from residual_mpc.diagnosis.predict.space import Space
from residual_mpc.effects.library import BY_NAME
from residual_mpc.models.settings import TUNE, Knob, Settings, Term, Values
from residual_mpc.models.size_numbers import size_knobs

Sizes = Mapping[Term, float]  # of a group: the factor on the size of each term that is listed; with 0 it does nothing


@dataclass(frozen=True)
class GroupSpace(Space):
    """groups: the sizes in the groups 1, 2, ... of windows (see `Block`)."""

    groups: tuple[Sizes, ...] = field(default=(), kw_only=True)

    def settings(self, hypotheses: Sequence[Values]) -> Settings:
        """One row per hypothesis, with the values in each group."""
        return in_groups(hypotheses, self.groups, super().settings)


def group_space(space: Space, groups: Sequence[Sizes]) -> GroupSpace:
    """The same hypotheses, with these sizes in the groups."""
    return GroupSpace(**{f.name: getattr(space, f.name) for f in fields(Space)}, groups=tuple(groups))


def in_groups(
    hypotheses: Sequence[Values], groups: Sequence[Sizes], settings: Callable[[Sequence[Values]], Settings]
) -> Settings:
    """The settings of hypotheses whose terms have these sizes in the groups."""
    here = settings(hypotheses)
    listed = {t for sizes in groups for t in sizes}
    if not any(k.term in listed for h in hypotheses for k in h):
        return here
    return replace(here, others=tuple(settings([sized(h, sizes) for h in hypotheses]) for sizes in groups))


def sized(values: Values, sizes: Sizes) -> Values:
    """The values with other sizes of some terms, within their physical bounds."""
    out = {k: v for k, v in values.items() if sizes.get(k.term) != 0.0}
    for term, factor in sizes.items():
        if factor not in (0.0, 1.0):
            for k in size_knobs(out, term):
                p = BY_NAME[k.effect].parameter(k.parameter)
                out[k] = float(np.clip(zero_of(k) + (values[k] - zero_of(k)) * factor, p.lower, p.upper))
    return out


def zero_of(knob: Knob) -> float:
    """From where the size of an effect counts: where it does nothing; 0 for a limit or a stiffness."""
    null = 0.0 if knob.effect == TUNE else BY_NAME[knob.effect].parameter(knob.parameter).null
    return null if np.isfinite(null) else 0.0
