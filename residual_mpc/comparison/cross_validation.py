"""Cross-validation over stretches: the gap of each fold is that of a model fitted without it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.fit.least_squares import Fit
from residual_mpc.diagnosis.predict.problem import Problem
from residual_mpc.models.settings import Knob, Values

STEPS = 3  # of a refit


@dataclass(frozen=True, eq=False)
class Folds:
    """number (W,): the fold of each of W windows; count: folds."""

    number: np.ndarray
    count: int


def folds_of(unit: np.ndarray, run: np.ndarray, later: np.ndarray, most: int) -> Folds:
    """Deal the windows of each set to at most `most` folds: by runs if both sets have as many, else by stretches. unit,
    run (W,): of each window; later (W,) bool."""
    by = run if min(len(np.unique(run[side])) for side in (later, ~later)) >= most else unit
    places = np.zeros(len(by), dtype=int)
    for side in (later, ~later):
        places[side] = np.unique(by[side], return_inverse=True)[1]
    count = min(most, *(int(places[side].max()) + 1 for side in (later, ~later)))
    return Folds(places % count, count)


def clear_of(fold: int, folds: Folds, tested: Dataset, fitted: Dataset) -> np.ndarray:
    """(W,) bool: the windows of `fitted` that share no time with the windows of this fold in `tested`."""
    out = np.ones(fitted.count, dtype=bool)
    mine = folds.number == fold
    sampled = np.isfinite(fitted.y).any(axis=2)
    length = np.where(sampled, fitted.t, 0.0).max(axis=1)
    for run in np.unique(tested.run[mine]):
        begin = np.sort(tested.start[mine & (tested.run == run)])
        here = np.flatnonzero(fitted.run == run)
        first = np.searchsorted(begin, fitted.start[here] - tested.horizon + 1e-6)
        out[here] = np.searchsorted(begin, fitted.start[here] + length[here] - 1e-6) <= first
    return out


def refitted(problem: Problem, fit: Fit, masks: Sequence[np.ndarray]) -> list[Values]:
    """The numbers of a fit when only the windows of each mask (W,) are seen: Gauss-Newton steps with the derivatives of
    the whole fit (the chord method; Ortega and Rheinboldt 1970, section 7.1). A number on which these windows do not
    depend, or that rests on a bound, stays; a step that raises the cost ends a refit."""
    if not fit.knobs:
        return [dict(fit.values) for _ in masks]
    inverses = [_inverse(fit.jacobian[mask], fit.held) for mask in masks]
    best: list[Values] = [dict(fit.values) for _ in masks]
    left = [fit.r for _ in masks]
    going = list(range(len(masks)))
    for _ in range(STEPS):
        tried = [_moved(problem, fit, best[k], inverses[k], masks[k], left[k]) for k in going]
        residuals = problem.residuals(tried)
        still = []
        for k, values, r in zip(going, tried, residuals, strict=True):
            if np.sum(r[masks[k]] ** 2) < np.sum(left[k][masks[k]] ** 2):
                best[k], left[k] = values, r
                still.append(k)
        going = still
        if not going:
            break
    return best


def _inverse(jacobian: np.ndarray, held: np.ndarray) -> np.ndarray:
    """(P, P) pseudo-inverse of the normal equations; zero for the numbers on a bound."""
    j = np.where(held, 0.0, jacobian)
    gram = np.einsum("wnp,wnq->pq", j, j, optimize=True)
    return np.asarray(np.linalg.pinv(gram, rcond=1e-10, hermitian=True))


def _moved(
    problem: Problem, fit: Fit, values: Values, inverse: np.ndarray, mask: np.ndarray, r: np.ndarray
) -> dict[Knob, float]:
    step = -inverse @ np.einsum("wnp,wn->p", fit.jacobian[mask], r[mask]) * fit.scales
    space = problem.space
    return {
        **values,
        **{k: float(np.clip(values[k] + d, *space.bounds(k))) for k, d in zip(fit.knobs, step, strict=True)},
    }
