"""A sparse regression on short prediction errors: the way of equation discovery.

Every candidate, nudged off its null, is one column of predicted change over a tenth of a second.
Sequentially thresholded least squares (Brunton, Proctor and Kutz 2016, algorithm 1) keeps the columns that
matter, and what is kept is named.
"""

from __future__ import annotations

import numpy as np

from residual_mpc.blind.baselines.all_at_once import _separate
from residual_mpc.blind.baselines.problem import BaselineProblem
from residual_mpc.diagnosis.data.subsampling import shorten
from residual_mpc.diagnosis.fit.least_squares import Fit, fit_all
from residual_mpc.diagnosis.predict.problem import build_problem
from residual_mpc.models.settings import Term, Values

_PART = 0.1  # of a window of one second
_THRESHOLD = 0.3  # of the largest contribution


def sparse(baseline: BaselineProblem) -> Fit | None:
    """The effects that survive the regression, fitted once more together on whole windows."""
    data = shorten(baseline.fitting.data, _PART)
    problem = build_problem(data, baseline.space, data.sigma)
    terms = _separate(baseline.space.candidates)
    if not terms:
        return None
    probes: list[Values] = [baseline.space.plausible(term)[0] for term in terms]
    rest, *moved = problem.residuals([{}, *probes])
    columns = np.stack([(rest - m).ravel() for m in moved], axis=1)
    kept = survivors(columns, rest.ravel(), _THRESHOLD)
    chosen: list[Term] = [terms[i] for i in kept]
    if not chosen:
        return None
    start = {knob: value for i in kept for knob, value in probes[i].items()}
    return fit_all(baseline.fitting, [start])[0]


def survivors(columns: np.ndarray, target: np.ndarray, threshold: float, rounds: int = 10) -> list[int]:
    """Indices of the columns (n, p) that sequentially thresholded least squares keeps for ``target`` (n,).

    ``threshold`` is on a column's contribution, as a share of the largest one.
    """
    size = np.linalg.norm(columns, axis=0)
    kept = np.flatnonzero(size > 1e-9 * max(float(size.max(initial=0.0)), 1e-300))
    for _ in range(rounds):
        if not len(kept):
            break
        scaled = columns[:, kept] / size[kept]
        contribution = np.abs(np.linalg.lstsq(scaled, target, rcond=1e-6)[0])
        large = contribution >= threshold * contribution.max()
        if large.all():
            break
        kept = kept[large]
    return [int(i) for i in kept]
