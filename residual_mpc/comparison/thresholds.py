"""How well the units tell a changed threshold (a dead zone, a limit, play), whose derivative says little.

A threshold acts where the motion crosses it, so the cost is a step function with a derivative of any size. The
jackknife therefore finds the smallest cost on a grid of values instead of taking a Gauss-Newton step.
"""

from dataclasses import replace

import numpy as np

from residual_mpc.comparison.sizes import Spread, jackknife
from residual_mpc.comparison.units import Units
from residual_mpc.diagnosis.fit.least_squares import Fit
from residual_mpc.diagnosis.predict.problem import Problem
from residual_mpc.effects.library import BY_NAME

GRID = np.array([0.5, 0.7, 0.8, 0.88, 0.94, 0.97, 0.985, 1.0, 1.015, 1.03, 1.06, 1.12, 1.2, 1.3, 1.5])  # of the value


def spread_of(problem: Problem, fit: Fit, units: Units) -> Spread:
    """How well the units tell each number of a fit."""
    return with_thresholds(problem, fit, units, jackknife(fit, units))


def with_thresholds(problem: Problem, fit: Fit, units: Units, spread: Spread) -> Spread:
    """The spread in which changed thresholds have that of the values with the smallest cost without one unit each, the
    other numbers held."""
    sigma, freedom = spread.sigma.copy(), spread.freedom.copy()
    for i, knob in enumerate(fit.knobs):
        if not knob.changed or fit.held[i] or not BY_NAME[knob.effect].parameter(knob.parameter).threshold:
            continue
        values = fit.values[knob] * GRID
        r = problem.residuals([{**fit.values, knob: float(v)} for v in values])
        costs = np.stack([units.summed(np.einsum("wn,wn->w", x, x)) for x in r])  # (values, units)
        whole = costs.sum(axis=1)
        here = _smallest(values, whole)
        share = np.array([(_smallest(values, whole - cost) - here) ** 2 for cost in costs.T])
        for side in (units.later, ~units.later):
            n = int(side.sum())
            share[side] *= (n - 1) / max(n, 1)
        variance = float(share.sum())
        step = 0.5 * abs(fit.values[knob]) * float(np.diff(GRID).min())  # what the grid cannot resolve
        sigma[i] = np.sqrt(max(variance, step**2))
        freedom[i] = max(variance**2 / float(np.sum(share**2)), 1.5) if variance > 0.0 else float(units.count)
    return replace(spread, sigma=sigma, freedom=freedom)


def _smallest(values: np.ndarray, costs: np.ndarray) -> float:
    """Where the cost is smallest: the vertex of the parabola through the smallest and its neighbours."""
    k = int(np.argmin(costs))
    if k in (0, len(values) - 1):
        return float(values[k])
    a, b, _ = np.polyfit(values[k - 1 : k + 2] - values[k], costs[k - 1 : k + 2], 2)
    if not a > 0.0:
        return float(values[k])
    return float(np.clip(values[k] - b / (2.0 * a), values[k - 1], values[k + 1]))
