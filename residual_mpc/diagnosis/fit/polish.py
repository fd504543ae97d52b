"""The last fits: to the end, from more than one start, on all windows."""

from collections.abc import Sequence
from dataclasses import dataclass

from residual_mpc.diagnosis.data.gap import Scales
from residual_mpc.diagnosis.data.subsampling import evenly
from residual_mpc.diagnosis.fit.evidence import blocks_of, dispersion
from residual_mpc.diagnosis.fit.least_squares import Fit, fit_all
from residual_mpc.diagnosis.fit.settings import FitSettings
from residual_mpc.diagnosis.fit.start_values import elsewhere
from residual_mpc.diagnosis.predict.longer_steps import on_longer_steps
from residual_mpc.diagnosis.predict.problem import Problem, part_of
from residual_mpc.models.settings import Knob, Values


@dataclass(frozen=True, eq=False)
class Polished:
    """fit: the best end; ends: for each free number, the values at which fits from other starts ended as well."""

    fit: Fit
    ends: dict[Knob, tuple[float, ...]]


def polish(
    problem: Problem, starts: Sequence[Values], steps: int, scales: Scales, settings: FitSettings
) -> list[Polished]:
    """Fit each start to the end, and once more from elsewhere. Where there are many windows, the starts are compared
    on a coarse part of `steps` simulation steps' worth of them, evenly spread, where they can be with longer time
    steps, and the best is carried on. scales: of the problem's motion."""
    tuned = settings.polish
    part = _part(problem, steps // tuned.coarse, settings=settings)
    coarse = on_longer_steps(part, scales, starts[0], settings=settings.predict)
    others = [elsewhere(problem, s, settings=settings) for s in starts]
    begin = [*starts, *(o for o in others if o is not None)]
    if coarse is problem:
        ends = fit_all(problem, begin, tuned.steps, tuned.tolerance, secants=0, settings=settings)
    else:
        ends = fit_all(coarse, begin, tuned.steps, tuned.coarse_tolerance, rough=True, settings=settings)
    again = iter(ends[len(starts) :])
    out = []
    for first, other in zip(ends, others, strict=False):
        out.append(_chosen(coarse, [first] if other is None else [first, next(again)], settings=settings))
    if coarse is problem:
        return out
    best = carry_on(problem, [p.fit.values for p in out], steps, settings=settings)
    return [Polished(fit, p.ends) for fit, p in zip(best, out, strict=True)]


def carry_on(problem: Problem, starts: Sequence[Values], steps: int, settings: FitSettings) -> list[Fit]:
    """The last steps of fits from near their ends: on `steps` simulation steps' worth of the windows, then on all."""
    tuned = settings.polish
    part = _part(problem, steps, settings=settings)
    best = fit_all(
        part,
        starts,
        tuned.more_steps,
        tuned.tolerance,
        secants=0 if part is problem else 2,
        rough=part is not problem,
        settings=settings,
    )
    return (
        best
        if part is problem
        else fit_all(
            problem,
            [f.values for f in best],
            tuned.last_steps,
            tuned.tolerance,
            secants=0,
            settings=settings,
        )
    )


def _part(problem: Problem, steps: int, settings: FitSettings) -> Problem:
    """So many simulation steps' worth of the windows; the problem itself where that is all of them."""
    few = evenly(problem.data, steps, settings=settings.data)
    return problem if few.all() else part_of(problem, few)


def _chosen(problem: Problem, fits: list[Fit], settings: FitSettings) -> Polished:
    """The cheapest of several ends of one fit, and where those that are as good ended."""
    best = min(fits, key=lambda f: f.cost)
    if len(fits) == 1 or not best.knobs:
        return Polished(best, {})
    reach = best.cost + settings.polish.equally_good * dispersion(best, blocks_of(problem.data, settings=settings))
    good = [f for f in fits if f.cost <= reach]
    return Polished(best, {k: tuple(f.values[k] for f in good) for k in best.knobs})
