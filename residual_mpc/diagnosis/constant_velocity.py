"""A forecast that knows no model: each channel goes on as it moved at the window's start."""

import numpy as np

from residual_mpc.diagnosis.dataset import Dataset

REACH = 0.15  # s: half of the stretch around a start through which the line is drawn


def constant_velocity(data: Dataset) -> np.ndarray:
    """(W, M, C) channel units: the line through each channel's samples around the window's start, continued; NaN where
    a channel has none there. A model that is worse than this says nothing about the runs."""
    out = np.full(data.y.shape, np.nan)
    for (i, c), signal in data.signals.items():
        k = data.channels.index(c)
        for w in np.flatnonzero(data.run == i):
            a, b = np.searchsorted(signal.t, [data.start[w] - REACH, data.start[w] + REACH])
            t, y = signal.t[a:b] - data.start[w], signal.y[a:b]
            if len(t) == 0:
                continue
            rate = 0.0
            if len(t) > 1:
                rate = float(np.sum((t - t.mean()) * (y - y.mean())) / np.sum((t - t.mean()) ** 2))
            out[w, :, k] = y.mean() + rate * (data.t[w] - t.mean())
    return out
