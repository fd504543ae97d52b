"""The hour's script: fit every single effect, keep the one that predicts the runs kept back best."""

from __future__ import annotations

from residual_mpc.blind.baselines.bench import Bench, cost_on
from residual_mpc.diagnosis.fit.least_squares import Fit, fit_all


def single(bench: Bench) -> Fit | None:
    """The best single effect; each is started from its most promising probe."""
    starts = []
    for term in bench.space.candidates:
        probes = bench.space.probes(term)
        costs = [float((r**2).sum()) for r in bench.fitting.residuals(probes)]
        starts.append(probes[costs.index(min(costs))])
    fits = fit_all(bench.fitting, starts)
    return min(fits, key=lambda fit: cost_on(bench.kept, fit.values), default=None)
