"""The fit without one of its effects, its other numbers moved to make up for it."""

import numpy as np

from residual_mpc.diagnosis.fit.cross_validation import LEAST, gauss_newton_step
from residual_mpc.diagnosis.fit.least_squares import Fit
from residual_mpc.diagnosis.predict.effect_sets import without
from residual_mpc.diagnosis.predict.problem import Problem
from residual_mpc.models.settings import TUNE, Knob, Term, Values


def readjusted(problem: Problem, final: Fit) -> dict[Term, Values]:
    """By effect the values without it, after one Gauss-Newton step of the others where that lowers the cost. problem:
    the one that the fit was made on.

    What an effect adds to a prediction says little about whether it is there: without it, others may do the same.
    """
    left = [without(final.values, t) for t in final.terms]
    if not left:
        return {}
    moved = [_moved(problem, final, t, r) for t, r in zip(final.terms, problem.residuals(left), strict=True)]
    costs = np.sum(problem.residuals([*left, *moved]).reshape(2, len(left), -1) ** 2, axis=-1)
    better = np.nan_to_num(costs[1], nan=np.inf) < np.nan_to_num(costs[0], nan=np.inf)
    return {t: moved[i] if better[i] else left[i] for i, t in enumerate(final.terms)}


def _moved(problem: Problem, final: Fit, gone: Term, r: np.ndarray) -> dict[Knob, float]:
    """The other numbers after a Gauss-Newton step from the residuals r (W, n) without the effect, inside their bounds;
    windows in which it diverges are left out."""
    stays = np.array([k.effect == TUNE or k.term != gone for k in final.knobs])
    step = gauss_newton_step(final, np.isfinite(r).all(axis=1), r, stays & ~final.held)
    out = {}
    for knob, dx, here in zip(final.knobs, step, stays, strict=True):
        if not here:
            continue
        value = final.values[knob]
        low, high = problem.space.bounds(knob)
        low = max(low, LEAST * value) if knob.effect == TUNE and value > 0.0 else low
        out[knob] = float(np.clip(value + dx, low, high))
    return out
