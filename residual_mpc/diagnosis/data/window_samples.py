"""What belongs to the samples of the signals, as the windows have them."""

from collections.abc import Mapping

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.logs.signals import fresh_samples


def in_windows(data: Dataset, values: Mapping[tuple[int, str], np.ndarray]) -> np.ndarray:
    """(W, M, C): values (n,) of each signal's samples, by run and channel, at the samples of the windows; NaN where
    these are missing."""
    out = np.full(data.y.shape, np.nan)
    for (run, channel), of in values.items():
        k, mine = data.channels.index(channel), np.flatnonzero(data.run == run)
        at = np.searchsorted(data.signals[run, channel].t, data.t[mine] + data.start[mine, None] - 1e-9)
        out[mine, :, k] = np.where(np.isfinite(data.y[mine, :, k]), of[np.minimum(at, len(of) - 1)], np.nan)
    return out


def fresh_in_windows(data: Dataset) -> np.ndarray:
    """(W, M, C) bool: the samples that are there and new readings, not repeats of a sensor's last one."""
    return in_windows(data, {key: fresh_samples(s.y).astype(float) for key, s in data.signals.items()}) == 1.0
