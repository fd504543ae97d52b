"""Channels that no gap compares but that saw what happened upstream: wheel encoders beside a measured pose.

An explanation that closes the gap of the pose and leaves the encoders as wrong as before put the cause on the
wrong side of them.
"""

import numpy as np

from residual_mpc.diagnosis.dataset import Dataset

FAR = 5.0  # sigmas of the channel's noise
VISIBLE = 0.06  # share of the channel's own size that the nominal model misses
UNMOVED = 0.7  # share of that miss that is still there


def contradicting(data: Dataset, before: np.ndarray, after: np.ndarray) -> tuple[str, ...]:
    """The witnesses against an explanation. before, after (W, M, C): measured - predicted without and with it."""
    rates = {s.velocity for b in data.blocks for s in b.robot.states}
    found = []
    for k, channel in enumerate(data.channels):
        if data.compared[:, k].any() or channel in rates:
            continue
        size = _rms(data.y[..., k])
        was, now = _rms(before[..., k]), _rms(after[..., k])
        if was > VISIBLE * size and now > FAR * data.sigma[k] and now > UNMOVED * was:
            found.append(channel)
    return tuple(found)


def _rms(x: np.ndarray) -> float:
    good = x[np.isfinite(x)]
    return float(np.sqrt(np.mean(good**2))) if len(good) else 0.0
