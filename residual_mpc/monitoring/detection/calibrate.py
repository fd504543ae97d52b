"""Thresholds that keep the promised rate of false alarms: simulated for a reference as short as the one at hand.

The test adds up means of blocks. From a reference of a few dozen blocks no resampling can tell what the rarest of the
thousands of blocks in 100 h look like, so that blocks are drawn from Student's distribution with heavy tails, as
correlated from one to the next, and from series to series, as the reference's own are. In each draw the reference is
drawn as well, and its mean and spread are estimated: charts with estimated parameters give many more false alarms
than their textbook thresholds promise (Jensen et al. 2006).
"""

from __future__ import annotations

import numpy as np

from residual_mpc.monitoring.detection.cusum import Thresholds
from residual_mpc.monitoring.settings import DetectionSettings


def calibrate(
    means: np.ndarray, block: int, horizon: float, rng: np.random.Generator, settings: DetectionSettings
) -> Thresholds:
    """means (B, S) of the reference's blocks of `block` windows."""
    n, series = means.shape
    persistence = float(np.clip(lag_one(means) + 1.0 / np.sqrt(n), 0.0, settings.persistence))
    together = _together(means)
    allowances = np.array(settings.allowances)
    length = int(np.ceil(settings.hours * 3600.0 / (horizon * block)))

    def drawn() -> np.ndarray:
        """(draws, S) of unit variance"""
        heavy = rng.standard_t(settings.tail, (settings.draws, series)) / np.sqrt(settings.tail / (settings.tail - 2.0))
        return np.asarray(heavy @ together.T)

    fresh = np.sqrt(1.0 - persistence**2)
    now = drawn()
    reference = np.empty((n, settings.draws, series))
    for k in range(n):
        reference[k] = now = persistence * now + fresh * drawn()
    centre, spread = reference.mean(axis=0), np.maximum(reference.std(axis=0, ddof=1), 1e-9)
    sums = np.zeros((settings.draws, len(allowances), 2, series))
    peaks = np.zeros_like(sums)
    for _ in range(length):
        now = persistence * now + fresh * drawn()
        z = np.clip((now - centre) / spread, -settings.clip, settings.clip)
        both = np.stack([z, -z], axis=1)[:, None]
        sums = np.maximum(0.0, sums + both - allowances[:, None, None])
        np.maximum(peaks, sums, out=peaks)
    highest = peaks.max(axis=(2, 3))  # (draws, A)
    share = (settings.false_alarm - settings.large) / len(allowances)
    levels = np.quantile(highest, 1.0 - share, axis=0, method="higher")
    return Thresholds(allowances, np.maximum(levels, 1.0))


def lag_one(means: np.ndarray) -> float:
    """Correlation of neighbouring blocks, over all series."""
    off = means - means.mean(axis=0)
    scaled = off / np.maximum(off.std(axis=0), 1e-9)
    return float(np.mean(scaled[1:] * scaled[:-1]))


def _together(means: np.ndarray) -> np.ndarray:
    """(S, S) whose product with independent numbers correlates them half as much as the reference's series: half, since
    a few blocks overstate it, and independent series raise more alarms."""
    found = np.nan_to_num(np.corrcoef(means.T)).reshape(means.shape[1], -1)
    return np.asarray(np.linalg.cholesky(0.5 * found + 0.5 * np.eye(len(found)) + 1e-9 * np.eye(len(found))))
