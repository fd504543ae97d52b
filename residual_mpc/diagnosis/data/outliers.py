"""Samples of the localisation or of an encoder that jump away and come back: flagged once, before anything is
fitted.
"""

from dataclasses import dataclass

import numpy as np

from residual_mpc.diagnosis.data.dataset import POSITION_LIKE, Dataset
from residual_mpc.diagnosis.data.settings import DataSettings
from residual_mpc.logs.signals import spikes


@dataclass(frozen=True)
class Outliers:
    """flagged[run, channel]: (n,) bool over that signal's samples; shares by channel, and over the position-like
    ones; enough: whether there are enough of them to be more than an accident, frequent: whether they are a cause
    whatever they do to the gap.
    """

    flagged: dict[tuple[int, str], np.ndarray]
    shares: dict[str, float]
    share: float
    count: int
    enough: bool
    frequent: bool


def find_outliers(data: Dataset, *, settings: DataSettings = DataSettings(), velocities: bool = False) -> Outliers:
    """Flag the samples that jump away, channel by channel. velocities: of these as well, in which a rough ground jumps
    like an outlier, so that only a difference between their shares tells anything."""
    flagged, hits, sizes = {}, dict.fromkeys(data.channels, 0), dict.fromkeys(data.channels, 0)
    for (i, c), s in data.signals.items():
        if not (velocities or c.split(".")[0] in POSITION_LIKE) or len(s.y) < 8:
            continue
        mask = spikes(s.t, s.y, float(data.sigma[data.channels.index(c)]))
        flagged[i, c] = mask
        hits[c] += int(mask.sum())
        sizes[c] += len(mask)
    # a localisation jumps as a whole: one stamp is one outlier, however many of its channels show it
    total = sum(hits.values())
    shares = {c: hits[c] / sizes[c] for c in data.channels if sizes[c]}
    share = max(shares.values(), default=0.0)
    return Outliers(
        flagged, shares, share, total, total >= settings.outliers.fewest, share >= settings.outliers.frequent
    )
