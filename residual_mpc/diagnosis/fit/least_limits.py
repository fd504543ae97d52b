"""Limits beyond the model's own that a robot hardly reaches: the data bound them from below and not from above."""

from dataclasses import replace

from residual_mpc.diagnosis.fit.evidence import blocks_of, dispersion
from residual_mpc.diagnosis.fit.least_squares import Fit, fit_all
from residual_mpc.diagnosis.fit.polish import Polished
from residual_mpc.diagnosis.fit.settings import FitSettings
from residual_mpc.diagnosis.predict.problem import Problem
from residual_mpc.models.settings import TUNE, Values

HALVINGS = 10  # of the way from the model's limit to the fitted one
AS_GOOD = 0.1  # times the dispersion, by which the cost may rise


def with_least_limits(problem: Problem, polished: Polished, settings: FitSettings) -> Polished:
    """The fit with each raised limit at the lowest value that explains as much. Above what the robot asks for the cost
    is flat, and a fit ends anywhere; the values where fits ended stay among `ends`, and the highest value that is
    looked for is one of them where it explains as much, too."""
    fit, ends = polished.fit, dict(polished.ends)
    own = {k: problem.space.reached_limit(k.term) for k in fit.knobs if k.effect != TUNE}
    raised = [k for k, limit in own.items() if 0.0 < limit < fit.values[k]]
    most = AS_GOOD * dispersion(fit, blocks_of(problem.data, settings=settings)) if raised else 0.0
    for knob in raised:
        low, high = own[knob], fit.values[knob]
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            as_good = _at(problem, {**fit.values, knob: middle}, settings).cost <= fit.cost + most
            low, high = (low, middle) if as_good else (middle, high)
        top = problem.space.bounds(knob)[1]
        open_above = _at(problem, {**fit.values, knob: top}, settings).cost <= fit.cost + most
        ends[knob] = (high, *ends.get(knob, (fit.values[knob],)), *((top,) if open_above else ()))
        fit = _at(problem, {**fit.values, knob: high}, settings)
    return replace(polished, fit=fit, ends=ends)


def _at(problem: Problem, values: Values, settings: FitSettings) -> Fit:
    (fit,) = fit_all(problem, [values], 0, settings=settings)
    return fit
