"""The noise floor as a figure: what a perfect model leaves under the sensors' noise, and whether a gap is beyond it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtri

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.gap import Gap, Scales, gap_of, per_window
from residual_mpc.diagnosis.data.local_fit import NEAREST, local_fits
from residual_mpc.diagnosis.data.subsampling import evenly
from residual_mpc.diagnosis.predict.longer_steps import quickened
from residual_mpc.diagnosis.predict.noise_errors import noise_errors
from residual_mpc.diagnosis.predict.settings import PredictSettings
from residual_mpc.models.settings import Settings

AS_GOOD = 2.0  # times the noise floor: as good as these sensors can tell (contract, section 5)
SMALL = 0.05  # of the motion: small enough, whatever the noise


@dataclass(frozen=True, eq=False)
class NoiseFloor:
    """The gap of a perfect model under the sensors' noise: its total and channels (C,), and what noise alone hardly
    ever exceeds; windows: from how many; typical: the gap of the median window, NaN where that was not asked."""

    total: float
    channels: np.ndarray
    luck: float
    channel_luck: np.ndarray
    windows: int
    typical: float = float("nan")


def floor_of(
    data: Dataset, scales: Scales, row: Settings, rng: np.random.Generator, settings: PredictSettings
) -> NoiseFloor:
    """The noise floor of the model `row` on these windows (of very many, evenly chosen ones, and those whose start is
    poorly measured if these are few), with the data's noise."""
    poor = poorly_begun(data, settings)
    keep = evenly(data, settings.floor.steps, settings=settings.data) | poor
    some = data if keep.all() else data.take(keep)
    each = np.where(poor, 1.0, (~poor).sum() / max((keep & ~poor).sum(), 1))[keep]  # windows that one stands for
    quick = quickened(some, scales, settings=settings, row=row)
    errors = noise_errors(quick, row, rng, settings.floor.draws, some)
    return floor_under(some, scales, errors, each, settings=settings)


def poorly_begun(data: Dataset, settings: PredictSettings) -> np.ndarray:
    """(W,) bool: windows that begin in a pause of a channel that the start state is taken from: the samples that it
    comes from are fewer, or spread over a multiple of what is usual. Such windows are few, but can dominate the noise
    floor; none where they are many, or cost more than the floor's share of simulation steps."""
    tuned = settings.floor
    spread = np.zeros(data.count)
    for channel in {c for b in data.blocks for s in b.robot.states for c, _, _ in s.sources}:
        signal = data.signals.joined(channel)
        if signal is None:
            continue
        fit = local_fits(signal, data.run, data.start)
        full = fit.count == NEAREST
        if not full.any():
            continue
        far = np.abs(signal.t[fit.index] - data.start[:, None]).max(axis=1)  # (W,) s
        usual = max(float(np.median(far[full])), 1e-9)
        spread = np.maximum(spread, np.where(full, far / usual, np.where(fit.count > 0, np.inf, 0.0)))
    poor = spread > tuned.poor_spread
    many = poor.sum() > tuned.most_poor * data.count
    if many or poor.sum() * data.cost > tuned.steps * data.count:  # evenly chosen ones will do
        return np.zeros(data.count, dtype=bool)
    return np.asarray(poor)


def floor_under(
    data: Dataset, scales: Scales, errors: np.ndarray, weights: np.ndarray, settings: PredictSettings
) -> NoiseFloor:
    """The floor from the errors (draws, W, M, C) that noise alone makes on windows with these weights (W,)."""
    counted = weights > 0
    found = floor_from([gap_of(data, scales, e, weights) for e in errors], int(counted.sum()), settings=settings)
    own = np.array([per_window(data, scales, e) for e in errors])
    medians = [_weighted_median(x, weights) for x in own]
    return replace(found, typical=float(np.sqrt(np.mean(medians))))


def _weighted_median(x: np.ndarray, weights: np.ndarray) -> float:
    """The median of x (W,), each of which counts as often as its weight (W,); NaN where none counts."""
    good = np.isfinite(x) & (weights > 0)
    if not good.any():
        return float("nan")
    order = np.argsort(x[good])
    passed = np.cumsum(weights[good][order])
    return float(x[good][order][np.searchsorted(passed, 0.5 * passed[-1])])


def floor_from(drawn: Sequence[Gap], windows: int, settings: PredictSettings) -> NoiseFloor:
    """The floor from the gaps that noise alone made on so many windows."""
    total = np.array([g.total**2 for g in drawn])
    channels = np.array([g.channels**2 for g in drawn])
    return NoiseFloor(
        float(np.sqrt(total.mean())),
        np.sqrt(channels.mean(axis=0)),
        float(with_luck(total, windows, settings=settings)),
        with_luck(channels, windows, settings=settings),
        windows,
    )


def with_luck(squares: np.ndarray, windows: int, settings: PredictSettings) -> np.ndarray:
    """The gap that noise hardly ever exceeds, from squared gaps (draws, ...) that it alone made on so many windows:
    they are taken for a chi-squared variable with the degrees of freedom that their scatter tells (Satterthwaite
    1946)."""
    mean = squares.mean(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        freedom = np.clip(2.0 * mean**2 / squares.var(axis=0, ddof=1), 1.0, settings.floor.freedom_per_window * windows)
    return np.asarray(np.sqrt(mean * chdtri(freedom, settings.floor.luck) / freedom))


def beyond_luck(gap: Gap, floor: NoiseFloor) -> bool:
    """Whether a gap is more than chance would make of the noise, in all or in one channel."""
    with np.errstate(invalid="ignore"):
        return bool(gap.total > floor.luck or (gap.channels > floor.channel_luck).any())


def beyond(gap: Gap, floor: NoiseFloor, settings: PredictSettings) -> bool:
    """Whether a gap is beyond the noise, in all or in one channel."""
    tuned = settings.floor
    few = 1.0 + tuned.few / floor.windows
    if gap.total > max(few * tuned.margin * floor.total, floor.luck):
        return True
    with np.errstate(invalid="ignore"):
        return bool((gap.channels > np.maximum(few * tuned.channel_margin * floor.channels, floor.channel_luck)).any())


def as_good_as_told(gap: Gap, floor: NoiseFloor) -> bool:
    """Whether a gap is as small as these sensors can tell, in all and in each channel."""
    if gap.total > max(AS_GOOD * floor.total, SMALL):
        return False
    with np.errstate(invalid="ignore"):
        return not bool((gap.channels > np.maximum(AS_GOOD * floor.channels, SMALL)).any())


def well_begun(data: Dataset, scales: Scales, rng: np.random.Generator, settings: PredictSettings) -> Dataset:
    """Without the windows whose start is so poorly measured (dropouts, few samples) that noise alone explains them."""
    noise = per_window(data, scales, noise_errors(data, Settings(1), rng, 1)[0])
    keep = ~(noise > settings.floor.poor_start * np.nanmedian(noise))
    return data.take(keep) if keep.sum() >= min(settings.data.subsampling.fewest, data.count) // 2 else data


def floor_draws(data: Dataset, steps: int, settings: PredictSettings) -> int:
    """How often the noise is drawn for the floor: as many simulation steps in all as most_draws times `steps`, so that
    a longer log, whose gap scatters less, does not cost more."""
    tuned = settings.floor
    cost = data.count * max(b.steps for b in data.blocks)
    return int(np.clip(tuned.most_draws * steps // cost, tuned.fewest_draws, tuned.most_draws))
