"""A forecast that knows no model: each channel goes on as it moved at the window's start."""

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.local_fit import REACH


def constant_velocity(data: Dataset) -> np.ndarray:
    """(W, M, C) channel units: the line through each channel's samples within REACH of the window's start, continued; a
    channel with one sample there stands still, with none it is NaN. A model that is worse than this says nothing about
    the runs."""
    out = np.full(data.y.shape, np.nan)
    for (i, c), signal in data.signals.items():
        mine = np.flatnonzero(data.run == i)
        if not len(mine) or not len(signal.y):
            continue
        first = np.searchsorted(signal.t, data.start[mine] - REACH - 1e-12)
        last = np.searchsorted(signal.t, data.start[mine] + REACH + 1e-12)
        count = last - first
        t, y = signal.t - signal.t[0], signal.y - signal.y[0]
        at = data.start[mine] - signal.t[0]

        def total(x: np.ndarray, first: np.ndarray = first, last: np.ndarray = last) -> np.ndarray:
            sums = np.concatenate([[0.0], np.cumsum(x)])
            return np.asarray(sums[last] - sums[first])

        with np.errstate(invalid="ignore", divide="ignore"):
            mean_t, mean_y = total(t) / count, total(y) / count
            spread = total(t * t) / count - mean_t**2
            rate = np.where(spread > 1e-9, (total(t * y) / count - mean_t * mean_y) / spread, 0.0)
        k = data.channels.index(c)
        out[mine, :, k] = signal.y[0] + (mean_y + rate * (at - mean_t))[:, None] + rate[:, None] * data.t[mine]
    return out
