"""Which samples of the windows are new readings, and not repeats of a sensor's last one."""

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.logs.signals import fresh_samples


def fresh_in_windows(data: Dataset) -> np.ndarray:
    """(W, M, C) bool: the samples that are there and fresh."""
    out = np.isfinite(data.y)
    for (run, channel), signal in data.signals.items():
        fresh = fresh_samples(signal.y)
        if channel not in data.channels or fresh.all():
            continue
        k, mine = data.channels.index(channel), np.flatnonzero(data.run == run)
        at = np.searchsorted(signal.t, data.t[mine] + data.start[mine, None] - 1e-9)
        out[mine, :, k] &= fresh[np.minimum(at, len(fresh) - 1)]
    return out
