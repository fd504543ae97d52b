"""Readings that repeat a slower sensor's last one: they were not measured when they are stamped, so that fits to them
would find a delay."""

from collections.abc import Mapping

import numpy as np

from residual_mpc.diagnosis.data.dataset import POSITION_LIKE, Dataset
from residual_mpc.diagnosis.data.outliers import with_outliers_removed
from residual_mpc.logs.signals import fresh_samples

SLOWER = 0.3  # share of the samples from which they are those of a slower sensor, and not of one that misses updates


def any_slow(data: Dataset) -> bool:
    """Whether a position sensor is slower than its log, in which its readings repeat."""
    return bool(with_stale(data, {}))


def with_stale(data: Dataset, flagged: Mapping[tuple[int, str], np.ndarray]) -> dict[tuple[int, str], np.ndarray]:
    """The flagged samples (n,) bool of each signal, by run and channel, and the stale ones of each slower position
    sensor."""
    out = dict(flagged)
    for key, signal in data.signals.items():
        stale = ~fresh_samples(signal.y)
        if key[1].split(".")[0] in POSITION_LIKE and stale.mean() > SLOWER:
            out[key] = out[key] | stale if key in out else stale
    return out


def without_repeats(data: Dataset) -> Dataset:
    """The windows without the stale samples of slower sensors."""
    return with_outliers_removed(data, with_stale(data, {}))
