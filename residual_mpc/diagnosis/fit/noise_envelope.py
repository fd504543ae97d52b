"""The largest noise whose increments lie under the measured ones."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.fit.settings import FitSettings
from residual_mpc.logs.signals import difference_sigma, fresh_samples


def difference_bounds(
    data: Dataset, weight: np.ndarray, times: Sequence[float], period: float, settings: FitSettings
) -> tuple[np.ndarray, np.ndarray]:
    """Upper bounds that the measurements set: the mean square of normalised differences of several orders over
    every n-th sample (B,), and what a unit of each part of each channel would add to it (B, C * P)."""
    limits, rows = [], []
    c, p = len(data.channels), len(times)
    for k, channel in enumerate(data.channels):
        mine = sorted((s for (_, name), s in data.signals.items() if name == channel), key=lambda s: -len(s.t))[:8]
        fresh = [(s.t[f], s.y[f]) for s in mine if (f := fresh_samples(s.y)).any()]
        for stride in settings.noise.strides:
            for order in settings.noise.orders:
                found = [difference_sigma(t[::stride], y[::stride], order) for t, y in fresh]
                if not (good := [x for x in found if np.isfinite(x) and x > 0.0]):
                    continue
                row = np.zeros((c, p))
                row[k] = [_difference_variance(order, stride * _spacing(fresh, period), time) for time in times]
                limits.append((float(np.median(good)) * weight[k]) ** 2)
                rows.append(row.ravel())
    return np.array(limits), np.array(rows).reshape(-1, c * p)


def _spacing(fresh: Sequence[tuple[np.ndarray, np.ndarray]], period: float) -> float:
    """s between fresh samples."""
    steps = [float(np.median(np.diff(t))) for t, _ in fresh if len(t) > 1]
    return float(np.median(steps)) if steps else period


def _difference_variance(order: int, step: float, time: float) -> float:
    """Variance of the normalised difference of unit noise with a correlation time, sampled every `step` s."""
    if time == 0.0:
        return 1.0
    weights = np.array([(-1.0) ** i * math.comb(order, i) for i in range(order + 1)])
    apart = np.abs(np.subtract.outer(np.arange(order + 1), np.arange(order + 1)))
    return float(weights @ np.exp(-apart * step / time) @ weights / (weights @ weights))


def fit_envelope(
    measured: np.ndarray,
    parts: np.ndarray,
    sure: np.ndarray,
    limits: np.ndarray,
    adds: np.ndarray,
    settings: FitSettings,
) -> np.ndarray:
    """(C, P) squared sizes of the parts whose increments lie under the measured ones, in relative least squares; a mean
    of n independent squares has a relative variance of 2 / n. What exceeds the `limits` weighs as much as the best
    known of the increments, what lies below them nothing."""
    c, p = parts.shape[2:]
    use = (sure > 0.0) & (measured > 0.0)
    rows, target = parts[use].reshape(-1, c * p), measured[use]
    if not len(target):
        return np.zeros((c, p))
    fit = _Envelope(
        np.concatenate([rows / target[:, None], adds / limits[:, None]]),
        np.concatenate([np.sqrt(sure[use]), np.full(len(limits), float(np.sqrt(sure.max())))]),
        np.concatenate([np.ones(len(target)), np.zeros(len(limits))]),
        settings,
    )
    columns = np.zeros((c, p), dtype=bool)
    columns[:, 0] = True
    size, misfit = fit.solve(columns.ravel())
    for k in range(c):  # a channel's noise is white unless its increments say otherwise
        more = columns.copy()
        more[k] = True
        again, less = fit.solve(more.ravel())
        if misfit - less > settings.noise.beyond_white:
            columns, size, misfit = more, again, less
    return size.reshape(c, p)


@dataclass(frozen=True, eq=False)
class _Envelope:
    """rows (R, C * P): what a unit of each part adds, relative to what was measured or to a limit; known (R,) how well;
    least (R,) 1 for what was measured, 0 for a limit, below which nothing weighs."""

    rows: np.ndarray
    known: np.ndarray
    least: np.ndarray
    settings: FitSettings

    def solve(self, columns: np.ndarray) -> tuple[np.ndarray, float]:
        """Squared sizes of the parts (C * P,), those of `columns` alone, and the weighted misfit."""
        from scipy.optimize import nnls  # slow to import

        aim = np.where(self.least > 0.0, 1.0, self.settings.noise.leeway)
        weight = self.known * self.least
        size = np.zeros(self.rows.shape[1])
        for _ in range(self.settings.noise.rounds):
            try:
                size[columns] = nnls(self.rows[:, columns] * weight[:, None], weight * aim, maxiter=500)[0]
            except RuntimeError:  # it has not converged: the sizes of the round before are near
                break
            again = self.known * np.sqrt(np.where(self.rows @ size > aim, self.settings.noise.excess, self.least))
            if np.array_equal(again, weight):
                break
            weight = again
        return size, float(np.sum((weight * (self.rows @ size - aim)) ** 2)) / 2.0
