"""Where a search may begin instead: with an effect of another kind than the one that it took first.

A greedy search adds to what it has. A stiff servo with strong friction and a weak servo with little friction predict
much the same over half a second, and whichever comes first keeps the other away: every single exchange makes it worse.
"""

from dataclasses import replace

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.gap import Scales
from residual_mpc.diagnosis.fit.least_squares import fit_all
from residual_mpc.diagnosis.fit.start_values import possible
from residual_mpc.diagnosis.predict.noise_floor import SMALL
from residual_mpc.diagnosis.predict.prediction_cache import PredictionCache
from residual_mpc.diagnosis.predict.problem import Problem
from residual_mpc.diagnosis.search.acceptance import squared_gaps
from residual_mpc.diagnosis.search.screen import screen
from residual_mpc.diagnosis.search.settings import SearchSettings
from residual_mpc.diagnosis.search.stepwise import Found
from residual_mpc.effects.actuator import ACTUATOR_GAIN
from residual_mpc.effects.body import COULOMB
from residual_mpc.models.settings import Term, Values

KINDS = (ACTUATOR_GAIN.name, COULOMB.name)  # all gains first, or all frictions
DOSES = 4  # of an effect that a start is fitted from


def other_start(found: Found, settings: SearchSettings) -> Term | None:
    """The effect that another search is to begin with; None where little is left, or where there is no such effect."""
    if not found.steps or not _much_left(found, settings):
        return None
    taken = {t.effect for t in found.steps[0].terms}
    candidates = found.problem.space.candidates
    for name in KINDS:
        here = [t for t in candidates if t.effect == name]
        whole = [t for t in here if t.target is None] or (here if len(here) == 1 else [])
        if whole and name not in taken:
            return whole[0]
    return None


def _much_left(found: Found, settings: SearchSettings) -> bool:
    """Whether a search leaves more than the sensors can tell from nothing, and a good part of what there was: what is
    little beside other gaps is much where the nominal model had no more."""
    first, left = found.ruler.squared([found.base, found.fit])
    return bool(left > found.ruler.threshold(min(SMALL**2, settings.rivals.part_left**2 * first)))


def begun_with(problem: Problem, term: Term, settings: SearchSettings) -> Values | None:
    """The fit of this effect alone; None where none of its doses promises anything."""
    base = fit_all(problem, [{k: problem.space.null(k) for k in problem.space.tunables}], settings=settings.fit)[0]
    leads = screen(problem, base, (term,), settings=settings)[:DOSES]
    if not leads:
        return None
    fits = fit_all(problem, [{**base.values, **lead.start} for lead in leads], settings=settings.fit)
    good = [f for f in fits if possible(f.values) and np.isfinite(f.cost)]
    return min(good, key=lambda f: f.cost).values if good else None


def better_everywhere(windows: Dataset, scales: Scales, found: Found, other: Found, settings: SearchSettings) -> Found:
    """The first of two results, unless the other one's gap is clearly smaller on these windows, of which the searches
    saw few. The last set of the one that is left is among those that were come across."""
    gaps = squared_gaps(PredictionCache(windows, found.problem.space), scales, [found.fit, other.fit], settings)
    if gaps[1] < settings.rivals.other_start * gaps[0]:
        found, other = other, found
    return replace(found, met=(other.fit, *found.met))
