"""A dead time and a lag, of which a search has found one.

Over many motions a dead time of 100 ms and one of 40 ms with a lag of 60 ms leave nearly the same gap where noise of
the pose wanders. Precise wheel speeds tell them apart all the same: the likelihood, which counts everything measured,
then speaks for both beyond doubt, though a search adds no effect that does not make the gap visibly smaller.
"""

from collections.abc import Iterator

import numpy as np

from residual_mpc.diagnosis.fit.evidence import blocks_of, dispersion
from residual_mpc.diagnosis.fit.least_squares import Fit, fit_all
from residual_mpc.diagnosis.fit.start_values import possible
from residual_mpc.diagnosis.predict.problem import Problem, tolerating
from residual_mpc.diagnosis.predict.space import Space
from residual_mpc.diagnosis.search.acceptance import Ruler
from residual_mpc.diagnosis.search.settings import SearchSettings
from residual_mpc.effects.library import BY_NAME
from residual_mpc.models.settings import TUNE, Knob, Values

# dead times and the lags that they trade with: a motor or filter of second order is neither
LATE = {"command delay": "command lag", "reading delay": "reading lag"}
EITHER = {**LATE, **{lag: delay for delay, lag in LATE.items()}}
LEAST = 0.1  # of their sum, below which the smaller one is what another law of the larger one may lack
STEPS = 12  # of the fit of both


def quantity_of(knob: Knob) -> str:
    """What of the model a number changes; empty for one that changes nothing by name."""
    return "" if knob.effect == TUNE else BY_NAME[knob.effect].parameter(knob.parameter).quantity or ""


def with_partner(problem: Problem, ruler: Ruler, fit: Fit, settings: SearchSettings) -> Fit | None:
    """The fit with the lag beside a dead time that it has, or the dead time beside a lag, where the likelihood speaks
    for both beyond the strictest doubt and the gap is not visibly larger; None where it does not."""
    starts: list[Values] = []
    for knob in (k for k in fit.knobs if fit.values[k] > 0.0):
        for other in _partners(problem.space, fit, knob):
            half = {k: float(np.clip(0.5 * fit.values[knob], *problem.space.bounds(k))) for k in (knob, other)}
            starts.append({**fit.values, **half})
    if not starts:
        return None
    plain = tolerating(problem, None)  # small differences may take up what tells the two apart
    alone, *ends = fit_all(plain, [fit.values, *starts], STEPS, settings=settings.fit)
    best = min((f for f in ends if possible(f.values)), key=lambda f: f.cost, default=None)
    if best is None or not _both_count(fit, best):
        return None
    strict = settings.without_tolerances()
    least = (strict.beyond_doubt + strict.per_knob) * dispersion(best, blocks_of(problem.data, settings=settings.fit))
    before, after = ruler.squared([alone, best])
    visible = max(settings.rivals.visible * ruler.floor, settings.rivals.share * before)
    return best if alone.cost - best.cost > least and after <= before + visible else None


def _partners(space: Space, fit: Fit, knob: Knob) -> Iterator[Knob]:
    """The number of the lag at the same place as a dead time, or of the dead time beside a lag, if it may join."""
    wanted = EITHER.get(quantity_of(knob))
    for term in space.candidates:
        if wanted is None or term.target != knob.target or not space.may_join(term, fit.terms):
            continue
        knobs = space.knobs(term)
        if [quantity_of(k) for k in knobs] == [wanted]:
            yield knobs[0]


def _both_count(fit: Fit, both: Fit) -> bool:
    """Whether neither the dead time nor the lag is a small part of the two."""
    (came,) = (k for k in both.values if k not in fit.values)
    (found,) = (k for k in fit.values if k.effect != TUNE and _is_partner(k, came))
    pair = both.values[came], both.values[found]
    return min(pair) > LEAST * sum(pair)


def _is_partner(knob: Knob, other: Knob) -> bool:
    return knob.target == other.target and EITHER.get(quantity_of(knob)) == quantity_of(other)
