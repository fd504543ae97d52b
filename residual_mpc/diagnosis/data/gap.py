"""The gap figure: how much of the motion within one horizon the model misses, per channel and in all."""

from dataclasses import dataclass

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.local_fit import local_fit
from residual_mpc.diagnosis.data.settings import DataSettings
from residual_mpc.errors import BadInput

STILL_SIGMAS = 3.0  # of its noise, under which a channel is still, by definition of the gap (contract, section 4)
STILL_STEPS = 3.0  # of its resolution, likewise


@dataclass(frozen=True)
class Scales:
    """The size of the motion: s (C,) channel units, and `still` (C,) bool for channels that hardly move or are not
    compared.
    """

    s: np.ndarray
    still: np.ndarray
    compared: np.ndarray  # (C,) bool: compared in some window

    @property
    def motion(self) -> np.ndarray:
        """(C,) the size of the motion, channel units; infinite for a channel that the gap leaves out."""
        return np.where(self.still, np.inf, self.s)


def still_channels(data: Dataset, scales: Scales) -> tuple[str, ...]:
    """The channels that are compared and hardly move."""
    resting = scales.still & scales.compared
    return tuple(c for c, still in zip(data.channels, resting, strict=True) if still)


@dataclass(frozen=True)
class Gap:
    """total and channels (C,) are unitless; a channel that is still or not compared holds NaN."""

    total: float
    channels: np.ndarray


def start_values(data: Dataset) -> np.ndarray:
    """(W, C) each channel's local value at the window's start; NaN where there is no sample near."""
    out = np.full((data.count, len(data.channels)), np.nan)
    for (i, c), signal in data.signals.items():
        mine = np.flatnonzero(data.run == i)
        out[mine, data.channels.index(c)] = local_fit(signal.t, data.start[mine]).value(signal.y)
    return out


def measure_scales(data: Dataset) -> Scales:
    """s_c: root mean square of c(t) - c(window start); pose.x and pose.y share the root of the sum of their squares.

    Raises BadInput where every channel is still: there is no motion to miss a share of.
    """
    moved = np.where(data.compared[:, None, :], data.y - start_values(data)[:, None, :], np.nan)
    with np.errstate(invalid="ignore"):
        count = np.isfinite(moved).sum(axis=(0, 1))
        s = np.sqrt(np.nansum(moved**2, axis=(0, 1)) / np.maximum(count, 1))
    compared = count > 0
    x, y = (data.channels.index(c) if c in data.channels else None for c in ("pose.x", "pose.y"))
    if x is not None and y is not None:
        s[[x, y]] = np.hypot(s[x], s[y])
    still = (s < STILL_SIGMAS * data.sigma) | (s < STILL_STEPS * data.steps) | ~compared
    if still.all():
        names = ", ".join(c for c, k in zip(data.channels, compared, strict=True) if k)
        raise BadInput(
            f"no channel moves by more than its noise and resolution within a window of {data.horizon:g} s: {names}",
            "runs",
            "record a motion, or give a longer horizon",
        )
    return Scales(np.where(s > 0, s, 1.0), still, compared)  # a still channel's size is never used


def gap_of(data: Dataset, scales: Scales, error: np.ndarray, windows: np.ndarray | None = None) -> Gap:
    """The gap of an error (W, M, C) = measured - predicted, NaN where nothing is compared; windows (W,) mask or
    weights.
    """
    square = np.where(data.compared[:, None, :], error, np.nan) ** 2
    weight = np.ones(data.count) if windows is None else windows.astype(float)
    total = np.nansum(square, axis=1)  # (W, C)
    count = np.isfinite(square).sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = (weight @ total) / (weight @ count)
        channels = np.where(scales.still, np.nan, np.sqrt(mean) / scales.s)
    if np.isnan(channels).all():
        return Gap(float("nan"), channels)
    return Gap(float(np.sqrt(np.nanmean(channels**2))), channels)


EARLY, AT_ONCE = 0.1, 0.5  # shares: of the window, and of its error that is there by then if its start is wrong


def with_sound_starts(data: Dataset, scales: Scales, error: np.ndarray, fewest: int) -> Gap:
    """The gap of an error (W, M, C) without its worst window, if that one misses from its very start: the state that it
    begins with is wrong, as after a spike or in a pause of a sensor. What a model gets wrong grows from nothing. The
    gap on all windows where these are fewer than that."""
    size = per_window(data, scales, error)
    if np.isfinite(size).sum() < fewest:
        return gap_of(data, scales, error)
    worst = int(np.nanargmax(size))
    with np.errstate(invalid="ignore"):
        early = np.where((data.t <= EARLY * data.horizon)[:, :, None], error, np.nan)
    at_once = per_window(data, scales, early)[worst]
    if not at_once > AT_ONCE**2 * size[worst]:
        return gap_of(data, scales, error)
    return gap_of(data, scales, error, np.arange(data.count) != worst)


def window_squares(data: Dataset, scales: Scales, error: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sums of scaled squares and counts (W, C) from which any subset's gap follows; for the bootstrap."""
    square = np.where(data.compared[:, None, :] & ~scales.still, (error / scales.s) ** 2, np.nan)
    return np.nansum(square, axis=1), np.isfinite(square).sum(axis=1).astype(float)


def gap_from_squares(total: np.ndarray, count: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Gaps (B,) for window weights (B, W)."""
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = (weight @ total) / (weight @ count)
        there = np.isfinite(mean)
        return np.asarray(np.sqrt(np.where(there, mean, 0.0).sum(axis=1) / there.sum(axis=1)))


def per_window(data: Dataset, scales: Scales, error: np.ndarray) -> np.ndarray:
    """(W,) mean over the channels of each window's mean scaled square; NaN where a window has nothing to compare."""
    total, count = window_squares(data, scales, error)
    with np.errstate(invalid="ignore", divide="ignore"):
        each = total / count
    empty = np.isnan(each).all(axis=1)
    return np.where(empty, np.nan, np.nanmean(np.where(empty[:, None], 0.0, each), axis=1))


def window_trust(data: Dataset, scales: Scales, error: np.ndarray, settings: DataSettings) -> np.ndarray:
    """(W,) weight of each window: 1, or less where its prediction has diverged. A window whose scaled error exceeds
    both `diverged` and `typical` times the median window's counts as one at that limit."""
    size = _sizes(data, scales, error)
    return _at_most(size, _diverged(size, settings))


def fit_trust(data: Dataset, scales: Scales, error: np.ndarray, settings: DataSettings) -> np.ndarray:
    """(W,) weight of each window in a fit: as `window_trust`, and a window that is unlike the others counts as one at
    `unlike` times the upper quartile of the windows' scaled errors (Huber's weights on whole windows)."""
    size = _sizes(data, scales, error)
    unlike = settings.trust.unlike * float(np.nanquantile(size, 0.75))
    return _at_most(size, min(_diverged(size, settings), unlike))


def _sizes(data: Dataset, scales: Scales, error: np.ndarray) -> np.ndarray:
    """(W,) scaled error of each window."""
    return np.sqrt(per_window(data, scales, np.clip(np.nan_to_num(error, nan=np.nan), -1e6, 1e6)))


def _diverged(size: np.ndarray, settings: DataSettings) -> float:
    """The scaled error beyond which a window's prediction has diverged."""
    return max(settings.trust.diverged, settings.trust.typical * float(np.nanmedian(size)))


def _at_most(size: np.ndarray, limit: float) -> np.ndarray:
    """(W,) weights with which no window counts for more than one with this scaled error."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(size > limit, (limit / size) ** 2, 1.0)
