"""The change that is nearest to being significant where none is: what more runs may show."""

from collections.abc import Sequence

import numpy as np

from residual_mpc.comparison.contrast import Contrast
from residual_mpc.comparison.space import ChangeSpace
from residual_mpc.effects.library import BY_NAME
from residual_mpc.models.parameter_units import unit_of
from residual_mpc.models.settings import Term

NEARLY = 0.9  # of the largest |z|, from which another change is named beside it
MOST = 3  # changes that a note names


def suspect_note(space: ChangeSpace, told: Sequence[Contrast], most: float) -> tuple[str, ...]:
    """A note on the change with the smallest p, where that is at most `most`, and on those with nearly as large a
    difference; none of them may be significant."""
    lead = min(told, key=lambda c: (c.p, -abs(c.z)), default=None)
    if lead is None or lead.p > most:
        return ()
    largest: dict[Term, Contrast] = {}
    for c in sorted((lead, *told), key=lambda c: (c is not lead, -abs(c.z))):
        if abs(c.z) >= NEARLY * abs(lead.z):
            largest.setdefault(c.term, c)
    named = [f"{term._replace(changed=False)}{_size(space, c)}" for term, c in list(largest.items())[:MOST]]
    return (
        f"A change of {' or '.join(named)} is the nearest to being significant, but among unchanged runs some change "
        f"looks as significant in {lead.p:.0%} of comparisons: record more runs to settle it",
    )


def _size(space: ChangeSpace, of: Contrast) -> str:
    """Roughly the size of a change, where one number that scales with the probe says it."""
    numbers = [p for p in BY_NAME[of.term.effect].parameters if not p.shape]
    if len(numbers) != 1 or numbers[0].threshold or not np.isfinite(numbers[0].null):
        return ""
    p, (value,) = numbers[0], (v for k, v in of.probe.items() if k.parameter == numbers[0].name)
    if p.null == 1.0:
        return f" by about {of.dose * (value - 1.0):+.1%}"
    return f" by about {of.dose * (value - p.null):+.2g} {unit_of(space.robot, of.term, p.unit)}".removesuffix(" 1")
