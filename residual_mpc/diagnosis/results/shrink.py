"""How far the gap shrinks: stated by cross-validation before the held-out windows are opened, then measured on them."""

from dataclasses import dataclass, replace

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.gap import Scales, gap_from_squares, window_squares
from residual_mpc.diagnosis.data.unlike_motions import unlike_share
from residual_mpc.diagnosis.fit.evidence import blocks_of
from residual_mpc.diagnosis.results.settings import ResultSettings


@dataclass(frozen=True)
class Shrink:
    """1 - after / before, with its 95 % interval from a block bootstrap."""

    value: float
    ci95: tuple[float, float]


def shrink_of(
    data: Dataset,
    scales: Scales,
    before: np.ndarray,
    after: np.ndarray,
    rng: np.random.Generator,
    settings: ResultSettings,
) -> Shrink:
    """The shrink between two errors (W, M, C) on the same windows, runs (or blocks of few runs) resampled."""
    return _shrink(data, scales, before, after, _bootstrap(data, rng, settings=settings))


def expected_shrink(
    data: Dataset,
    held: Dataset,
    scales: Scales,
    before: np.ndarray,
    after: np.ndarray,
    rng: np.random.Generator,
    settings: ResultSettings,
) -> Shrink:
    """As `shrink_of`, with the interval in which the shrink on `held` will lie: besides these windows being few, those
    are few as well, and those that are driven unlike all others may not shrink at all. Of `held` nothing but the number
    of its runs (or blocks) and how they are driven is used."""
    drawn, unit = _draws(data, rng, settings=settings)
    n = len(np.unique(held.run if _by_run(data) else blocks_of(held, settings=settings.fit)))
    again = rng.multinomial(max(n, 1), drawn / drawn.sum(axis=1, keepdims=True))
    expected = _shrink(data, scales, before, after, again[:, unit].astype(float))
    unlike, (low, high) = 0.0 if held is data else unlike_share(data, held, settings.data), expected.ci95
    return replace(expected, ci95=(low - unlike * max(low, 0.0), high))


def _shrink(data: Dataset, scales: Scales, before: np.ndarray, after: np.ndarray, draws: np.ndarray) -> Shrink:
    total_before, count_before = window_squares(data, scales, before)
    total_after, count_after = window_squares(data, scales, after)
    weight = np.concatenate([np.ones((1, data.count)), draws])
    ratio = 1.0 - gap_from_squares(total_after, count_after, weight) / gap_from_squares(
        total_before, count_before, weight
    )
    low, high = np.nanquantile(ratio[1:], [0.025, 0.975])
    return Shrink(float(ratio[0]), (float(low), float(high)))


def _bootstrap(data: Dataset, rng: np.random.Generator, settings: ResultSettings) -> np.ndarray:
    """(draws, W) how often each window is drawn, when whole runs (or blocks of time, with few runs) are drawn."""
    drawn, unit = _draws(data, rng, settings=settings)
    return np.asarray(drawn[:, unit], dtype=float)


def _draws(data: Dataset, rng: np.random.Generator, settings: ResultSettings) -> tuple[np.ndarray, np.ndarray]:
    """(draws, U) how often each unit is drawn, and (W,) each window's unit."""
    unit = np.unique(data.run, return_inverse=True)[1] if _by_run(data) else blocks_of(data, settings=settings.fit)
    n = int(unit.max()) + 1
    return rng.multinomial(n, np.full(n, 1.0 / n), size=settings.bootstrap), unit


def _by_run(data: Dataset) -> bool:
    return len(np.unique(data.run)) >= 8
