"""Which known effect the remainder resembles: each that may be added is screened, the best few are fitted alone."""

from dataclasses import replace

import numpy as np

from residual_mpc.diagnosis.data.subsampling import evenly
from residual_mpc.diagnosis.fit.least_squares import Fit, fit_all, on_problem
from residual_mpc.diagnosis.fit.start_values import possible
from residual_mpc.diagnosis.predict.longer_steps import on_longer_steps
from residual_mpc.diagnosis.predict.problem import Problem, part_of
from residual_mpc.diagnosis.remainder.records import Resemblance
from residual_mpc.diagnosis.remainder.settings import RemainderSettings
from residual_mpc.diagnosis.search.acceptance import Ruler
from residual_mpc.diagnosis.search.additions import distinct, mixed
from residual_mpc.diagnosis.search.screen import glance, rankings
from residual_mpc.models.settings import Term, Values


def resembles(
    problem: Problem, current: Fit, vetoed: tuple[Term, ...], judge: Ruler, settings: RemainderSettings
) -> Resemblance | None:
    """The effect whose fit on top of the current ones closes most of the rest; None where none closes any."""
    found = closest(problem, current, vetoed, judge, settings)
    if found is None or not found[1] >= settings.resemblance.least:
        return None
    fit, closes = found
    (term,) = set(fit.terms) - set(current.terms)
    return Resemblance(term, min(closes, 1.0))


def closest(
    problem: Problem, current: Fit, vetoed: tuple[Term, ...], judge: Ruler, settings: RemainderSettings
) -> tuple[Fit, float] | None:
    """The rough fit with one more effect that closes most of the rest, and the share of the squared gap beyond the
    floor that it closes; None where nothing may be added."""
    resemblance = settings.resemblance
    keep = evenly(problem.data, resemblance.steps, settings=settings.data)
    small = problem if keep.all() else part_of(problem, keep)
    small = on_longer_steps(small, judge.scales, current.values, settings=settings.predict)
    here = on_problem(small, current, settings=settings.fit)
    space = problem.space
    eligible = tuple(t for t in space.candidates if t not in vetoed and space.may_join(t, current.terms))
    if not eligible:
        return None
    leads = glance(small, here, eligible, settings=settings.search)
    ranked = mixed(*rankings(leads))
    best: dict[Term, Values] = {}
    for lead in ranked:
        best.setdefault(lead.term, {**current.values, **lead.start})
    starts = list(best.values())[: resemblance.fitted]
    tried = fit_all(small, starts, resemblance.most, rough=True, near=[here] * len(starts), settings=settings.fit)
    fits = [f for f in distinct(tried) if possible(f.values)]
    if not fits:
        return None
    data = judge.replays.data
    few = evenly(data, resemblance.steps, settings=settings.data)
    seen = judge if few.all() else replace(judge, replays=judge.replays.of(data.take(few), few))
    *after, before = seen.squared([*fits, current]) - judge.floor  # windows are trusted by the last of them
    closes = 1.0 - np.asarray(after) / max(float(before), 1e-12)
    k = int(np.argmax(closes))
    return fits[k], float(closes[k])
