"""The quadratic through the samples nearest to an instant: start states, as a linear map of the samples.

As the gap's definition has it: the five samples nearest in time that are not missing and within 0.25 s; with three
or four samples still a quadratic, with two a line, with one that sample.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from residual_mpc.diagnosis.data.signals import JoinedSignal

REACH = 0.25  # s: how far from a window's start its samples may lie (contract, section 4)
NEAREST = 5  # of them (likewise)
KEPT = 128  # fits cached per function: bounds the memory, as does
LARGE = 10_000  # queries above which a fit of all runs is not cached


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
    return _of_one_run(t.astype(float).tobytes(), query.astype(float).tobytes())


def local_fits(signal: JoinedSignal, run: np.ndarray, query: np.ndarray) -> LocalFit:
    """Fit at each query time (Q,) s, by the clock of its run (Q,), through the samples of that run alone; `index`
    refers to the joined samples. The latest fits are kept, unless they are large, and must not be written to."""
    if len(query) > LARGE:
        return _of_all_runs(signal, run, query)
    return _kept(signal, run.astype(np.int64).tobytes(), query.astype(float).tobytes())


@lru_cache(maxsize=KEPT)
def _of_one_run(stamps: bytes, queries: bytes) -> LocalFit:
    t, query = np.frombuffer(stamps), np.frombuffer(queries)
    return _fit(t, np.searchsorted(t, query), 0, len(t), query)


@lru_cache(maxsize=KEPT)
def _kept(signal: JoinedSignal, runs: bytes, queries: bytes) -> LocalFit:
    return _of_all_runs(signal, np.frombuffer(runs, dtype=np.int64), np.frombuffer(queries))


def _of_all_runs(signal: JoinedSignal, run: np.ndarray, query: np.ndarray) -> LocalFit:
    known = run < len(signal.first)
    run = np.where(known, run, 0)
    end = np.where(known, signal.end[run], 0)
    around = np.searchsorted(signal.line, query + signal.offset[run])
    return _fit(signal.t, around, signal.first[run], end, query)


def _fit(
    t: np.ndarray, around: np.ndarray, first: np.ndarray | int, end: np.ndarray | int, query: np.ndarray
) -> LocalFit:
    """Each query uses the samples from first to end - 1 (Q,) of t (n,) s alone; around (Q,): where it lies in t."""
    q, n = len(query), len(t)
    if n == 0:
        zero = np.zeros((q, NEAREST))
        return LocalFit(np.zeros((q, NEAREST), dtype=int), zero, zero, zero, np.zeros(q, dtype=int))
    near = around[:, None] + np.arange(-NEAREST, NEAREST)[None, :]
    inside = (near >= np.reshape(first, (-1, 1))) & (near < np.reshape(end, (-1, 1)))
    near = np.clip(near, 0, n - 1)
    away = np.where(inside, np.abs(t[near] - query[:, None]), np.inf)
    pick = np.argsort(away, axis=1, kind="stable")[:, :NEAREST]
    index = np.take_along_axis(near, pick, axis=1)
    usable = np.take_along_axis(away, pick, axis=1) <= REACH + 1e-12
    count = usable.sum(axis=1)
    s = np.where(usable, t[index] - query[:, None], 0.0)
    return LocalFit(index, *_weights(s, usable.astype(float)), count)


def _weights(s: np.ndarray, used: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(Q, 5) each, for the value, the slope and the curvature at s = 0 of the polynomial through the samples at s (Q,
    5) s; used (Q, 5): 0 or 1. The degree is 2, less with fewer than three samples. Polynomials that are orthogonal on
    the samples (Forsythe, J. SIAM 5, 1957) need no matrix inverse."""
    count = used.sum(axis=1, keepdims=True)
    some = np.maximum(count, 1.0)
    mean = (used * s).sum(axis=1, keepdims=True) / some
    line = used * (s - mean)
    square = (line**2).sum(axis=1, keepdims=True)
    line_of = np.divide(line, square, out=np.zeros_like(s), where=(count > 1) & (square > 0.0))
    bend = (line**3).sum(axis=1, keepdims=True) / np.where(square > 0.0, square, 1.0)
    parabola = used * ((s - mean) * line - bend * line - square / some)
    square2 = (parabola**2).sum(axis=1, keepdims=True)
    parabola_of = np.divide(parabola, square2, out=np.zeros_like(s), where=(count > 2) & (square2 > 0.0))
    value = used / some - mean * line_of + (mean**2 + bend * mean - square / some) * parabola_of
    return value, line_of - (2.0 * mean + bend) * parabola_of, 2.0 * parabola_of
