"""The last fits: to the end, from more than one start, on all windows."""

from collections.abc import Sequence
from dataclasses import dataclass

from residual_mpc.diagnosis.evidence import blocks_of, dispersion
from residual_mpc.diagnosis.fit import Fit, elsewhere, fit_all
from residual_mpc.diagnosis.problem import Problem, part_of
from residual_mpc.diagnosis.thinning import evenly
from residual_mpc.models.settings import Knob, Values

STEPS, TOLERANCE = 24, 1e-6  # steps and relative gain at which a fit ends
LAST = 2  # of these steps that are on all windows, where there are too many for all
EQUALLY_GOOD = 4.0  # likelihood ratio within which two ends of a fit are as good as each other


@dataclass(frozen=True, eq=False)
class Polished:
    """fit: the best end; ends: for each free number, the values at which fits from other starts ended as well."""

    fit: Fit
    ends: dict[Knob, tuple[float, ...]]


def polish(problem: Problem, starts: Sequence[Values], steps: int) -> list[Polished]:
    """Fit each start to the end, and once more from elsewhere: on `steps` simulation steps' worth of windows, evenly
    spread, and the last steps on all."""
    few = evenly(problem.data, steps)
    part = problem if few.all() else part_of(problem, few)
    others = [elsewhere(problem, s) for s in starts]
    begin = [*starts, *(o for o in others if o is not None)]
    near = fit_all(part, begin, STEPS, TOLERANCE, rough=not few.all(), secants=0 if few.all() else 2)
    again = iter(near[len(starts) :])
    out = []
    for first, other in zip(near, others, strict=False):
        out.append(_chosen(part, [first] if other is None else [first, next(again)]))
    if few.all():
        return out
    last = fit_all(problem, [p.fit.values for p in out], LAST, TOLERANCE, secants=0)
    return [Polished(fit, p.ends) for fit, p in zip(last, out, strict=True)]


def _chosen(problem: Problem, fits: list[Fit]) -> Polished:
    """The cheapest of several ends of one fit, and where those that are as good ended."""
    best = min(fits, key=lambda f: f.cost)
    if len(fits) == 1 or not best.knobs:
        return Polished(best, {})
    reach = best.cost + EQUALLY_GOOD * dispersion(best, blocks_of(problem.data))
    good = [f for f in fits if f.cost <= reach]
    return Polished(best, {k: tuple(f.values[k] for f in good) for k in best.knobs})
