"""The quadratic through the samples nearest to an instant: start states, as a linear map of the samples.

As the gap's definition has it: the five samples nearest in time that are not missing and within 0.25 s; with three
or four samples still a quadratic, with two a line, with one that sample.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

REACH = 0.25  # s: how far from a window's start its samples may lie (contract, section 4)
NEAREST = 5  # of them (likewise)
KEPT = 128  # fits that are kept: bounds the memory


@dataclass(frozen=True)
class LocalFit:
    """value = sum(value_weights * y[index]), slope and curvature likewise; rows of zero weights where `count` is 0.

    index (Q, 5) into the samples, value_weights (Q, 5) unitless, slope_weights (Q, 5) 1/s, curvature_weights (Q, 5)
    1/s^2, count (Q,) samples used.
    """

    index: np.ndarray
    value_weights: np.ndarray
    slope_weights: np.ndarray
    curvature_weights: np.ndarray
    count: np.ndarray

    def value(self, y: np.ndarray) -> np.ndarray:
        """(Q,) fitted values at the queries for samples y (n,); NaN where there is no sample."""
        return self._apply(self.value_weights, y, 1)

    def slope(self, y: np.ndarray) -> np.ndarray:
        """(Q,) fitted rates at the queries, per second; NaN where there are fewer than two samples."""
        return self._apply(self.slope_weights, y, 2)

    def curvature(self, y: np.ndarray) -> np.ndarray:
        """(Q,) fitted second derivatives at the queries, per second squared; NaN where there are fewer than three
        samples."""
        return self._apply(self.curvature_weights, y, 3)

    def _apply(self, weights: np.ndarray, y: np.ndarray, least: int) -> np.ndarray:
        if not len(y):
            return np.full(len(self.count), np.nan)
        return np.where(self.count >= least, np.einsum("qi,qi->q", weights, y[self.index]), np.nan)


def local_fit(t: np.ndarray, query: np.ndarray) -> LocalFit:
    """Fit at each query time (Q,) s through samples at t (n,) s, increasing and none missing. A diagnosis asks for the
    same starts with every replay: the latest fits are kept, and must not be written to."""
    return _local_fit(t.astype(float).tobytes(), query.astype(float).tobytes())


@lru_cache(maxsize=KEPT)
def _local_fit(stamps: bytes, queries: bytes) -> LocalFit:
    t, query = np.frombuffer(stamps), np.frombuffer(queries)
    q, n = len(query), len(t)
    if n == 0:
        zero = np.zeros((q, NEAREST))
        return LocalFit(np.zeros((q, NEAREST), dtype=int), zero, zero, zero, np.zeros(q, dtype=int))
    around = np.searchsorted(t, query)[:, None] + np.arange(-NEAREST, NEAREST)[None, :]
    inside = (around >= 0) & (around < n)
    around = np.clip(around, 0, n - 1)
    away = np.where(inside, np.abs(t[around] - query[:, None]), np.inf)
    pick = np.argsort(away, axis=1, kind="stable")[:, :NEAREST]
    index = np.take_along_axis(around, pick, axis=1)
    usable = np.take_along_axis(away, pick, axis=1) <= REACH + 1e-12
    count = usable.sum(axis=1)
    s = np.where(usable, (t[index] - query[:, None]) / REACH, 0.0)  # scaled time keeps the normal equations tame
    order = np.minimum(count - 1, 2)[:, None]  # 2: quadratic, 1: line, 0: one sample
    basis = np.stack([np.ones_like(s), s, s * s], axis=-1) * usable[..., None]
    basis = basis * (np.arange(3)[None, None, :] <= order[..., None])
    weights = np.linalg.pinv(basis) / np.array([1.0, REACH, 0.5 * REACH**2])[None, :, None]  # (Q, 3, 5)
    return LocalFit(index, weights[:, 0], weights[:, 1], weights[:, 2], count)
