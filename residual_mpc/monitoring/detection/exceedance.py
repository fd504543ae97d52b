"""Errors far above those of the reference: a large change, told after a few windows.

The cumulative sums add up ranks, and from a short reference their thresholds are high: they say the same of an error
that is twice as large as of one that is thirty times as large. Here the size counts: the mean logarithm of the last
windows' errors lies above the prediction limit for one more such mean, given those of the reference.
"""

from __future__ import annotations

import numpy as np
from scipy.stats import t as student

from residual_mpc.monitoring.detection.calibrate import lag_one
from residual_mpc.monitoring.settings import DetectionSettings


def limits(rest: np.ndarray, horizon: float, settings: DetectionSettings) -> np.ndarray:
    """(S,) what the mean of a stretch of the stream exceeds with probability `large` at most in `hours` of steady
    running. rest (W, S): what of the logarithm of the reference's squared errors the driving does not tell.

    The prediction limit for one more value of a normal sample (Hahn 1970), of m means of stretches whose number is
    reduced by the correlation r of neighbours, as for the mean of an autoregression: m (1 - r) / (1 + r).
    """
    n = settings.large_windows
    count = len(rest) // n
    means = rest[: count * n].reshape(count, n, -1).mean(axis=1)
    r = float(np.clip(lag_one(means) + 1.0 / np.sqrt(count), 0.0, settings.persistence))
    independent = max(count * (1.0 - r) / (1.0 + r), 2.0)
    tests = settings.hours * 3600.0 / horizon * rest.shape[1]
    factor = student.isf(settings.large / tests, independent - 1.0) * np.sqrt(1.0 + 1.0 / independent)
    return np.asarray(means.mean(axis=0) + factor * means.std(axis=0, ddof=1))


def far_above(rest: np.ndarray, limit: np.ndarray, settings: DetectionSettings) -> int | None:
    """The series whose last stretch exceeds its limit most; None where none does, or where too few of the last windows
    (W, S) have a value (NaN where the driving is unlike the reference's)."""
    last = rest[-settings.large_windows :]
    known = np.isfinite(last)
    enough = known.sum(axis=0) >= settings.large_known * settings.large_windows
    beyond = np.where(enough, np.where(known, last, 0.0).sum(axis=0) / np.maximum(known.sum(axis=0), 1) - limit, -1.0)
    series = int(beyond.argmax())
    return series if beyond[series] > 0.0 else None
