"""The last fits: to the end, from more than one start, on all windows."""

from collections.abc import Sequence
from dataclasses import dataclass

from residual_mpc.diagnosis.data.subsampling import evenly
from residual_mpc.diagnosis.fit.evidence import blocks_of, dispersion
from residual_mpc.diagnosis.fit.least_squares import Fit, elsewhere, fit_all
from residual_mpc.diagnosis.predict.problem import Problem, part_of
from residual_mpc.models.settings import Knob, Values

STEPS, TOLERANCE = 24, 1e-6  # steps and relative gain at which a fit ends
COARSE, NEAR = 4, 1e-4  # part of the windows on which several starts are compared, and the gain at which that ends
MORE, LAST = 8, 2  # further steps of the best on more windows, and on all, where there are too many for all
EQUALLY_GOOD = 4.0  # likelihood ratio within which two ends of a fit are as good as each other


@dataclass(frozen=True, eq=False)
class Polished:
    """fit: the best end; ends: for each free number, the values at which fits from other starts ended as well."""

    fit: Fit
    ends: dict[Knob, tuple[float, ...]]


def polish(problem: Problem, starts: Sequence[Values], steps: int) -> list[Polished]:
    """Fit each start to the end, and once more from elsewhere. Where there are many windows, the starts are compared
    on a COARSE part of `steps` simulation steps' worth of them, evenly spread, and the best is carried on."""
    coarse = _part(problem, steps // COARSE)
    others = [elsewhere(problem, s) for s in starts]
    begin = [*starts, *(o for o in others if o is not None)]
    if coarse is problem:
        ends = fit_all(problem, begin, STEPS, TOLERANCE, secants=0)
    else:
        ends = fit_all(coarse, begin, STEPS, NEAR, rough=True)
    again = iter(ends[len(starts) :])
    out = []
    for first, other in zip(ends, others, strict=False):
        out.append(_chosen(coarse, [first] if other is None else [first, next(again)]))
    if coarse is problem:
        return out
    best = carry_on(problem, [p.fit.values for p in out], steps)
    return [Polished(fit, p.ends) for fit, p in zip(best, out, strict=True)]


def carry_on(problem: Problem, starts: Sequence[Values], steps: int) -> list[Fit]:
    """The last steps of fits from near their ends: on `steps` simulation steps' worth of the windows, then on all."""
    part = _part(problem, steps)
    best = fit_all(part, starts, MORE, TOLERANCE, secants=0 if part is problem else 2, rough=part is not problem)
    return best if part is problem else fit_all(problem, [f.values for f in best], LAST, TOLERANCE, secants=0)


def _part(problem: Problem, steps: int) -> Problem:
    """So many simulation steps' worth of the windows; the problem itself where that is all of them."""
    few = evenly(problem.data, steps)
    return problem if few.all() else part_of(problem, few)


def _chosen(problem: Problem, fits: list[Fit]) -> Polished:
    """The cheapest of several ends of one fit, and where those that are as good ended."""
    best = min(fits, key=lambda f: f.cost)
    if len(fits) == 1 or not best.knobs:
        return Polished(best, {})
    reach = best.cost + EQUALLY_GOOD * dispersion(best, blocks_of(problem.data))
    good = [f for f in fits if f.cost <= reach]
    return Polished(best, {k: tuple(f.values[k] for f in good) for k in best.knobs})
