"""Fits that have not seen part of the windows, and their errors there."""

from collections.abc import Mapping

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.fit.evidence import blocks_of
from residual_mpc.diagnosis.fit.least_squares import Fit
from residual_mpc.diagnosis.fit.settings import FitSettings
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.diagnosis.predict.space import Space
from residual_mpc.models.settings import TUNE, Knob, Values

LEAST = 0.1  # of a retuned parameter, in one fold: none becomes negative
MOST = 5.0  # scales of a number: longer steps leave the range in which the derivatives hold


def gauss_newton_step(fit: Fit, windows: np.ndarray, r: np.ndarray, free: np.ndarray) -> np.ndarray:
    """(P,) the step of the free numbers (P,) bool, each in its unit, 0 for the others; from residuals r (W, n) on these
    windows (W,) bool."""
    step = np.zeros(len(fit.knobs))
    j = fit.jacobian[windows].reshape(-1, len(fit.knobs))[:, free]
    if free.any() and len(j):
        step[free] = -np.linalg.lstsq(j, r[windows].ravel(), rcond=None)[0]
    return np.clip(step, -MOST, MOST) * fit.scales


def fold_values(fit: Fit, folds: np.ndarray) -> list[Values]:
    """The fit without each fold: one Gauss-Newton step from the whole (exact for a linear model)."""
    if not fit.knobs:
        return [{}] * (int(folds.max()) + 1)
    out: list[Values] = []
    free = ~fit.held
    for k in range(int(folds.max()) + 1):
        whole = np.array(list(fit.values.values()))
        moved = whole + gauss_newton_step(fit, folds != k, fit.r, free)
        tuned = np.array([knob.effect == TUNE for knob in fit.knobs])
        moved = np.where(tuned & (whole > 0), np.maximum(moved, LEAST * whole), moved)
        out.append(dict(zip(fit.knobs, moved.tolist(), strict=True)))
    return out


def folds_of(data: Dataset, settings: FitSettings) -> np.ndarray:
    """(W,) fold numbers: by run where there are many, else stretches of time."""
    present = np.unique(data.run)
    if len(present) >= settings.folds:
        return np.searchsorted(present, data.run) % settings.folds
    blocks = blocks_of(data, settings=settings)
    return (blocks * settings.folds) // (int(blocks.max()) + 1)


def expected_errors(data: Dataset, space: Space, fit: Fit, settings: FitSettings) -> np.ndarray:
    """(W, M, C) measured - predicted, each window predicted by the fit that has not seen its fold."""
    folds = folds_of(data, settings=settings)
    error = np.empty_like(data.y)
    for k, values in enumerate(fold_values(fit, folds)):
        mine = folds == k
        if mine.any():
            unseen = data.take(mine)
            error[mine] = unseen.y - predict(unseen, space.settings([_inside(space, values)]))[0]
    return error


def _inside(space: Space, values: Mapping[Knob, float]) -> Values:
    return {k: float(np.clip(v, *space.bounds(k))) for k, v in values.items()}
