"""Samples of the localisation or of an encoder that jump away and come back: flagged once, before anything is
fitted.

A driver that differentiates an encoder's readings makes a jump of the velocity of each of their outliers, and if it
filters the velocity, a jump that decays over several samples. Such samples are flagged with the outlier.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from residual_mpc.diagnosis.data.dataset import POSITION_LIKE, Dataset
from residual_mpc.diagnosis.data.settings import DataSettings, OutlierSettings
from residual_mpc.diagnosis.data.signals import Signal, Signals
from residual_mpc.logs.jumps import spikes


@dataclass(frozen=True)
class Outliers:
    """flagged[run, channel]: (n,) bool over that signal's samples, with those of a velocity that an outlier of the
    position spoils; shares, without them, by channel and over the position-like ones; enough: whether there are enough
    of them to be more than an accident, frequent: whether they are a cause whatever they do to the gap.
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
    for key, spoilt in list(_spoilt_velocities(data, flagged, settings.outliers)):
        flagged[key] = flagged[key] | spoilt if key in flagged else spoilt
    # a localisation jumps as a whole: one stamp is one outlier, however many of its channels show it
    total = sum(hits.values())
    shares = {c: hits[c] / sizes[c] for c in data.channels if sizes[c]}
    share = max(shares.values(), default=0.0)
    return Outliers(
        flagged, shares, share, total, total >= settings.outliers.fewest, share >= settings.outliers.frequent
    )


def _spoilt_velocities(
    data: Dataset, flagged: dict[tuple[int, str], np.ndarray], settings: OutlierSettings
) -> Iterator[tuple[tuple[int, str], np.ndarray]]:
    """The samples (n,) bool of the joints' velocities, by run and channel, that outliers of their positions spoil."""
    for (i, channel), mask in flagged.items():
        joint = channel.removeprefix("position.")
        velocity = data.signals.get((i, f"velocity.{joint}"))
        if joint == channel or velocity is None or not mask.any():
            continue
        sigma = float(data.sigma[data.channels.index(f"velocity.{joint}")])
        at = np.searchsorted(velocity.t, data.signals[i, channel].t[mask] - 1e-9)
        spoilt = jumps_at(velocity.y, np.unique(at), sigma, settings)
        if spoilt.any():
            yield (i, f"velocity.{joint}"), spoilt


def jumps_at(v: np.ndarray, rows: np.ndarray, sigma: float, settings: OutlierSettings) -> np.ndarray:
    """(n,) bool: the samples of v (n,) from those at `rows`, or from the one before, that lie off the line between the
    samples before and after, until one no longer does. sigma: 1-sigma of the noise, in the unit of v."""
    out = np.zeros(len(v), dtype=bool)
    side, most = settings.beside, settings.longest
    for row in rows:
        first, last = row - 1, row + most  # what a central difference of the outlier reaches, and a filter's longest
        before, after = np.arange(first - side, first), np.arange(last, last + side)
        if before[0] < 0 or after[-1] >= len(v):
            continue
        ends = np.median(v[before]), np.median(v[after])
        usual = max(np.abs(np.diff(v[part])).max() for part in (before, after))
        off = np.abs(v[first:last] - np.linspace(*ends, last - first))
        far = off > np.maximum(settings.far * sigma, settings.far * usual)
        begin = int(far[:3].argmax())
        if far[begin]:
            length = int(np.argmin(np.append(far[begin:], False)))
            out[first + begin : first + begin + length] = True
    return out


def with_outliers_removed(data: Dataset, flagged: Mapping[tuple[int, str], np.ndarray]) -> Dataset:
    """The dataset without the flagged samples. flagged[run, channel]: (n,) bool over that signal's samples."""
    signals = dict(data.signals)
    y = data.y.copy()
    for (i, c), mask in flagged.items():
        if not mask.any():
            continue
        s = signals[i, c]
        bad = s.t[mask]
        signals[i, c] = Signal(s.t[~mask], s.y[~mask])
        for w in np.flatnonzero(data.run == i):
            hit = np.isin(np.round(data.t[w] + data.start[w], 9), np.round(bad, 9))
            y[w, hit, data.channels.index(c)] = np.nan
    return replace(data, signals=Signals(signals), y=y)
