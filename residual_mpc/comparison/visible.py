"""The minimum detectable effect for each change: what `same` rules out, and what it does not."""

from collections.abc import Sequence

import numpy as np

from residual_mpc.comparison.contrast import Contrast
from residual_mpc.comparison.records import VisibleChange
from residual_mpc.comparison.space import ChangeSpace
from residual_mpc.effects.library import BY_NAME
from residual_mpc.models.parameter_units import unit_of
from residual_mpc.models.settings import Knob, Term


def smallest_visible(space: ChangeSpace, told: Sequence[Contrast], level: float) -> tuple[VisibleChange, ...]:
    """For each change with a single parameter that scales with its size, the size that at least four comparisons in
    five would find, from the most sensitive contrast; in the order of the contrasts. It is never below the size that a
    contrast estimates here where that is not significant, p above `level`; what no effect can reach is left out."""
    least: dict[Term, VisibleChange] = {}
    for c in told:
        numbers = [p for p in BY_NAME[c.term.effect].parameters if not p.shape]
        if len(numbers) != 1 or numbers[0].threshold or not np.isfinite(numbers[0].null) or not np.isfinite(c.visible):
            continue
        p, (value,) = numbers[0], (v for k, v in c.probe.items() if k.parameter == numbers[0].name)
        least_dose = max(c.visible, abs(c.dose)) if c.p > level else c.visible
        size = least_dose * abs(value - p.null)
        low, high = space.later_bounds(Knob(c.term.effect, c.term.target, p.name))
        if size > max(high - p.null, p.null - low):
            continue  # no effect can be that large
        if c.term not in least or size < least[c.term].size:
            unit = unit_of(space.robot, c.term, "1" if p.null == 1.0 else p.unit)
            least[c.term] = VisibleChange(c.term, p.name, size, unit)
    return tuple(least.values())
