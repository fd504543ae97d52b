"""Another start for numbers that say how an effect acts, where a fit has left them at a bound.

A spring that swings without any damping has a cost with many minima along its stiffness, one for each phase of the
swing, and a fit that has once lost its damping stays in one of them. With more damping there are fewer.
"""

from residual_mpc.diagnosis.fit.least_squares import Fit, fit_all
from residual_mpc.diagnosis.predict.problem import Problem
from residual_mpc.diagnosis.search.optional_numbers import AT_BOUND
from residual_mpc.diagnosis.search.settings import SearchSettings
from residual_mpc.effects.library import BY_NAME
from residual_mpc.models.settings import TUNE, Knob


def at_shape_bounds(problem: Problem, fit: Fit) -> dict[Knob, tuple[float, float]]:
    """The bounds of the numbers in a fit that rest at one of them and say how their effect acts."""
    found = {}
    for knob, value in fit.values.items():
        if knob.effect == TUNE or not BY_NAME[knob.effect].parameter(knob.parameter).shape:
            continue
        low, high = problem.space.bounds(knob)
        near = AT_BOUND * (high - low)
        if 0.0 < near < float("inf") and not low + near < value < high - near:
            found[knob] = (low, high)
    return found


def off_bounds(problem: Problem, fit: Fit, settings: SearchSettings) -> Fit:
    """The set fitted again with these numbers begun inside their bounds; the fit itself where that costs no less."""
    ends = at_shape_bounds(problem, fit)
    if not ends:
        return fit
    tuned = settings.additions
    starts = [{**fit.values, **{k: low + x * (high - low) for k, (low, high) in ends.items()}} for x in tuned.inside]
    again = fit_all(problem, starts, tuned.again, settings=settings.fit)
    return min([fit, *again], key=lambda f: f.cost)
