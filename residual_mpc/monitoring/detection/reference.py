"""The gap of the model in steady running: what windows of the stream are ranked against."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from residual_mpc.diagnosis.data.gap import Scales, measure_scales
from residual_mpc.errors import BadInput
from residual_mpc.logs.run import Run
from residual_mpc.monitoring.detection.calibrate import calibrate, lag_one
from residual_mpc.monitoring.detection.cusum import Thresholds
from residual_mpc.monitoring.detection.exceedance import limits
from residual_mpc.monitoring.detection.neighbours import (
    Driving,
    Usual,
    driving_space,
    neighbour_count,
    ranked,
    usual_errors,
)
from residual_mpc.monitoring.model import WatchedModel
from residual_mpc.monitoring.settings import DetectionSettings
from residual_mpc.monitoring.windows import Windows, dataset_of, windows_of

EVERYTHING = "all channels"


@dataclass(frozen=True, eq=False)
class Scored:
    """Windows of the stream. error (W, 1 + C): relative squared errors; familiar (W,) bool: whether the reference has
    windows that were driven alike; far (W,) bool: whether they were driven less alike than nine in ten of the
    reference's own; rest, scores (W, 1 + C): what of the errors' logarithm the driving does not tell, and its normal
    score among these, NaN where there are none."""

    error: np.ndarray
    familiar: np.ndarray
    far: np.ndarray
    rest: np.ndarray
    scores: np.ndarray


@dataclass(frozen=True, eq=False)
class Reference:
    """names: of all channels, with their scales; channels (C,): those that are compared and move.

    windows: of the reference; error (W, 1 + C): relative squared errors of all channels together and of each; rest
    (W, 1 + C): what of their logarithm the driving does not tell (`usual`); place (W, K) in the driving's space;
    reach: distance within which a window has neighbours; usual_reach: that within which nine in ten of its own
    have; whole (C,): samples of a whole window; block: windows of a block; centre, spread (1 + C,): of the means of
    a block's scores; limits (1 + C,): what the mean `rest` of the last windows exceeds after a large change;
    described: where it comes from; runs: for the comparison with what comes after a change."""

    names: tuple[str, ...]
    channels: tuple[str, ...]
    scales: Scales
    windows: Windows
    error: np.ndarray
    usual: Usual
    rest: np.ndarray
    driving: Driving
    place: np.ndarray
    reach: float
    usual_reach: float
    whole: np.ndarray
    block: int
    centre: np.ndarray
    spread: np.ndarray
    limits: np.ndarray
    thresholds: Thresholds
    described: str
    runs: tuple[Run, ...]
    settings: DetectionSettings

    @property
    def gap(self) -> float:
        """Root of the mean square over all windows."""
        return float(np.sqrt(np.nanmean(self.error[:, 0])))

    @property
    def series(self) -> tuple[str, ...]:
        """What is tested: all channels together, and each."""
        return (EVERYTHING, *self.channels)

    def errors(self, windows: Windows) -> np.ndarray:
        """(W, 1 + C) relative squared errors; NaN where too few samples were compared."""
        return relative(windows, self.names, self.channels, self.scales, self.whole, self.settings.whole)

    def scored(self, windows: Windows) -> Scored:
        """Windows of the stream against those of the reference that were driven alike."""
        error = self.errors(windows)
        k = neighbour_count(len(self.windows), self.settings)
        place = self.driving.of(windows.driving)
        rest = self.usual.without(error, _numbers(windows, place, self.names, self.channels))
        apart = np.linalg.norm(place[:, None] - self.place[None], axis=2)
        nearest = np.argsort(apart, axis=1, kind="stable")[:, :k]
        middle = np.take_along_axis(apart, nearest[:, k // 2 : k // 2 + 1], axis=1)[:, 0]
        familiar, far = middle <= self.reach, middle > self.usual_reach
        known = np.isfinite(error) & familiar[:, None]
        scores = ranked(rest, self.rest[nearest])
        return Scored(error, familiar, far, np.where(known, rest, np.nan), np.where(known, scores, np.nan))

    def standardised(self, scores: np.ndarray) -> np.ndarray:
        """(1 + C,) the mean of a block's scores (block, 1 + C) in standard deviations of such means; NaN where fewer
        than half of them are known."""
        known = np.isfinite(scores).mean(axis=0) >= 0.5
        mean = np.nansum(scores, axis=0) / np.maximum(np.isfinite(scores).sum(axis=0), 1)
        limit = self.settings.clip
        return np.where(known, np.clip((mean - self.centre) / self.spread, -limit, limit), np.nan)


def build_reference(
    runs: Sequence[Run],
    model: WatchedModel,
    noise: Mapping[str, float],
    horizon: float,
    described: str,
    rng: np.random.Generator,
    settings: DetectionSettings,
) -> Reference:
    """Raises BadInput for runs that are too short, or in which nothing moves."""
    data = dataset_of(runs, model, noise, horizon)
    scales = measure_scales(data)
    names = data.channels
    channels = tuple(c for c, still in zip(names, scales.still, strict=True) if not still)
    windows = windows_of(data, model, names, scales)
    with np.errstate(invalid="ignore"):
        usual = np.median(np.where(windows.count > 0, windows.count, np.nan), axis=0)
    usual = np.nan_to_num(usual, nan=1.0)
    error = relative(windows, names, channels, scales, usual, settings.whole)
    whole = np.isfinite(error[:, 0])
    windows, error = windows.take(whole), error[whole]
    fewest = settings.blocks[0] * settings.fewest_blocks
    if len(windows) < fewest:
        raise BadInput(
            f"a reference needs at least {fewest} windows of {horizon:g} s, got {len(windows)}",
            described,
            "give more or longer runs as `reference`, or learn it from a longer part of the stream",
        )
    space = driving_space(windows.driving, settings)
    place = space.of(windows.driving)
    numbers = _numbers(windows, place, names, channels)
    fitted = usual_errors(error, numbers, settings)
    rest = fitted.without(error, numbers)
    own, (usual_reach, reach) = _own_scores(rest, place, settings)
    block, means = _blocks(own, settings)
    centre, spread = means.mean(axis=0), np.maximum(means.std(axis=0, ddof=1), 1e-9)
    thresholds = calibrate(means, block, horizon, rng, settings)
    return Reference(
        names, channels, scales, windows, error, fitted, rest, space, place, reach, usual_reach, usual, block, centre,
        spread, limits(rest, horizon, settings), thresholds, described, tuple(runs), settings,
    )  # fmt: skip


def _own_scores(
    rest: np.ndarray, place: np.ndarray, settings: DetectionSettings
) -> tuple[np.ndarray, tuple[float, float]]:
    """(W, 1 + C) scores of the reference's windows among each other, those near in time left out, and the distances
    within which nine in ten of them, and a window of the stream, have neighbours."""
    k = neighbour_count(len(rest), settings)
    apart = np.linalg.norm(place[:, None] - place[None], axis=2)
    index = np.arange(len(rest))
    apart[np.abs(index[:, None] - index[None]) < settings.blocks[0]] = np.inf
    nearest = np.argsort(apart, axis=1, kind="stable")[:, :k]
    middle = np.take_along_axis(apart, nearest[:, k // 2 : k // 2 + 1], axis=1)
    reaches = float(np.quantile(middle, 0.9)), settings.familiar * float(np.quantile(middle, 0.99))
    return ranked(rest, rest[nearest]), reaches


def _blocks(scores: np.ndarray, settings: DetectionSettings) -> tuple[int, np.ndarray]:
    """The length of a block, and the means (B, 1 + C) of the reference's."""
    chosen = None
    for length in settings.blocks:
        count = len(scores) // length
        if chosen is not None and count < settings.fewest_blocks:
            break
        means = scores[: count * length].reshape(count, length, -1).mean(axis=1)
        chosen = (length, means)
        if lag_one(means) < settings.correlated:
            break
    assert chosen is not None
    return chosen


def _numbers(windows: Windows, place: np.ndarray, names: Sequence[str], channels: Sequence[str]) -> np.ndarray:
    """(W, D) what errors are regressed on: how far each channel moves, and the driving."""
    return np.column_stack([windows.moved[:, [list(names).index(c) for c in channels]], place])


def relative(
    windows: Windows, names: Sequence[str], channels: Sequence[str], scales: Scales, usual: np.ndarray, whole: float
) -> np.ndarray:
    """(W, 1 + C): mean square error of each channel by the size of its motion, behind the mean over the channels."""
    index = [list(names).index(c) for c in channels]
    each = windows.square[:, index] / scales.s[index] ** 2
    each = np.where(windows.count[:, index] >= whole * usual[index], each, np.nan)
    return np.column_stack([each.mean(axis=1), each])
