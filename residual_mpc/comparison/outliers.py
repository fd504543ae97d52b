"""Whether a sensor has more outliers in one set of runs than in the other: they are counted, since no fit sees them."""

from collections.abc import Mapping

import numpy as np
from scipy.special import stdtrit

from residual_mpc.comparison.records import Change, ChangedNumber
from residual_mpc.comparison.sets import TwoSets
from residual_mpc.comparison.settings import ContrastSettings
from residual_mpc.diagnosis.data.outlier_share import expected_jumps
from residual_mpc.effects.sensor import SENSOR_OUTLIERS
from residual_mpc.models.settings import Term


def changed_outliers(sets: TwoSets, most_sure: float, settings: ContrastSettings) -> Change | None:
    """The change of the share of outliers in the channel where the sets differ most surely; None where they differ by
    no more than stretches of one set do.

    The flagged shares of the stretches are compared by their ranks (Mann and Whitney 1947), with Bonferroni's
    correction for the number of channels, since a few bad stretches are no change. The rates count the jumps that were
    not flagged as well (see `expected_jumps`).
    """
    if not sets.outliers.enough:
        return None
    from scipy.stats import mannwhitneyu  # half a second to load, for what few runs have

    channels = sorted({c for _, c in sets.outliers.flagged})
    found = []
    for channel in channels:
        shares, later = _shares(sets, sets.outliers.flagged, channel, settings)
        sides = shares[~later], shares[later]
        if min(map(len, sides)) < settings.fewest or np.ptp(shares) == 0.0:
            continue
        p = min(1.0, len(channels) * float(mannwhitneyu(*sides).pvalue))
        found.append((p, -abs(float(sides[1].mean() - sides[0].mean())), channel))
    if not found or min(found)[0] > settings.outliers:
        return None
    p, _, channel = min(found)
    shares, later = _shares(sets, _expected(sets, channel), channel, settings)
    rate = _rate(shares[~later], shares[later])
    return Change(Term(SENSOR_OUTLIERS.name, None), most_sure * (1.0 - p), p, (rate,), SENSOR_OUTLIERS.summary)


def _expected(sets: TwoSets, channel: str) -> dict[tuple[int, str], np.ndarray]:
    """(n,) number of jumps for which each sample of a channel stands, by run; each set has jumps of its own size."""
    data = sets.raw
    sigma = float(data.sigma[data.channels.index(channel)])
    out: dict[tuple[int, str], np.ndarray] = {}
    for side in (False, True):
        flagged = {(i, c): m for (i, c), m in sets.outliers.flagged.items() if c == channel and sets.later[i] == side}
        out |= expected_jumps(data.signals, flagged, sigma)
    return out


def _rate(before: np.ndarray, after: np.ndarray) -> ChangedNumber:
    """The difference of the mean shares of the stretches, with Welch's interval."""
    parts = [np.var(side, ddof=1) / len(side) for side in (before, after)]
    variance = sum(parts)
    freedom = variance**2 / sum(v**2 / (len(s) - 1) for v, s in zip(parts, (before, after), strict=True) if v > 0.0)
    half = float(stdtrit(freedom, 0.975) * np.sqrt(variance))
    was, now = float(before.mean()), float(after.mean())
    return ChangedNumber("rate", was, now, now - was, (now - was - half, now - was + half), "1")


def _shares(
    sets: TwoSets, jumps: Mapping[tuple[int, str], np.ndarray], channel: str, settings: ContrastSettings
) -> tuple[np.ndarray, np.ndarray]:
    """(U,) mean of the jumps (n,) over the samples of each stretch; (U,) bool, whether it belongs to the later set."""
    shares: list[float] = []
    later: list[bool] = []
    for side in (False, True):
        runs = [i for i, c in jumps if c == channel and bool(sets.later[i]) == side]
        pieces = int(np.ceil(settings.units / max(len(runs), 1)))
        for i in runs:
            t, counts = sets.raw.signals[i, channel].t, jumps[i, channel]
            n = int(np.clip((t[-1] - t[0]) / settings.unit, 1, pieces))
            edges = np.linspace(t[0], t[-1], n + 1)[1:-1]
            each = [part.mean() for part in np.split(counts, np.searchsorted(t, edges)) if len(part)]
            shares += each
            later += [side] * len(each)
    return np.array(shares), np.array(later)
