"""The paper's H2 norm over seconds of data: the Euclidean norm of reference minus prediction at one instant.

It is no norm of a system. Its figures are means over 10 s of data.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

SPAN = 10.0  # s of data in a mean
NEAR = 0.1  # of the final value


@dataclass(frozen=True)
class H2:
    """first and last: means over the first and the last 10 s of data; converged_after: s of data after which the
    running mean stays within a tenth of its final value, None where it did not fall."""

    first: float | None
    last: float | None
    converged_after: float | None


def summary(norms: np.ndarray, step: float) -> H2:
    """norms (n,) one a step of `step` s, NaN where nothing was measured."""
    running = running_mean(norms, step)
    n = max(1, round(SPAN / step))
    if not np.isfinite(running).any():
        return H2(None, None, None)
    first, last = _mean(norms[:n]), _mean(norms[-n:])
    if first is None or last is None or last >= first:
        return H2(first, last, None)
    off = np.flatnonzero(~(np.abs(running - last) <= NEAR * last) & np.isfinite(running))
    return H2(first, last, float((off[-1] + 2 if len(off) else 1) * step))


def running_mean(norms: np.ndarray, step: float) -> np.ndarray:
    """(n,) mean over the last 10 s of data at each step; over what is there at the beginning."""
    n = max(1, round(SPAN / step))
    good = np.isfinite(norms)
    total = np.concatenate([[0.0], np.cumsum(np.where(good, norms, 0.0))])
    count = np.concatenate([[0], np.cumsum(good)])
    at = np.arange(1, len(norms) + 1)
    before = np.maximum(at - n, 0)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray((total[at] - total[before]) / (count[at] - count[before]))


def mean_of(parts: Sequence[np.ndarray]) -> float | None:
    """Mean over all steps of several windows; None where nothing was measured."""
    return _mean(np.concatenate(parts)) if len(parts) else None


def _mean(x: np.ndarray) -> float | None:
    good = x[np.isfinite(x)]
    return float(good.mean()) if len(good) else None
