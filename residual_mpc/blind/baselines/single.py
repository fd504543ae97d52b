"""The hour's script: fit every single effect, keep the one that predicts the runs kept back best."""

from __future__ import annotations

from residual_mpc.blind.baselines.problem import BaselineProblem, cost_on
from residual_mpc.diagnosis.fit.least_squares import Fit, fit_all


def single(problem: BaselineProblem) -> Fit | None:
    """The best single effect; each is started from its most promising probe."""
    starts = []
    for term in problem.space.candidates:
        probes = problem.space.plausible(term)
        costs = [float((r**2).sum()) for r in problem.fitting.residuals(probes)]
        starts.append(probes[costs.index(min(costs))])
    fits = fit_all(problem.fitting, starts)
    return min(fits, key=lambda fit: cost_on(problem.kept, fit.values), default=None)
