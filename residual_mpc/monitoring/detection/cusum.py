"""Cumulative sums (Page 1954) of blocks' means, for errors that grow and that shrink, with several allowances."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Thresholds:
    """allowances (A,): what is taken from each mean; levels (A,): a sum above them is an alarm."""

    allowances: np.ndarray
    levels: np.ndarray


@dataclass(frozen=True, eq=False)
class Sums:
    """sums (A, 2, S) for A allowances, errors that grow and errors that shrink, and S series; since (A, 2, S): number
    of the block at which each was last zero."""

    sums: np.ndarray
    since: np.ndarray
    count: int


@dataclass(frozen=True)
class Alarm:
    """series: index of what changed; grows: whether its errors grow; since: number of the first block after the
    change, 0 the first of all."""

    series: int
    grows: bool
    since: int


def init(allowances: int, series: int) -> Sums:
    return Sums(np.zeros((allowances, 2, series)), np.zeros((allowances, 2, series), dtype=int), 0)


def step(state: Sums, means: np.ndarray, thresholds: Thresholds) -> Sums:
    """One block: standardised means (S,), NaN where a series has none, which then stays as it is."""
    both = np.stack([means, -means])[None]
    grown = np.maximum(0.0, state.sums + both - thresholds.allowances[:, None, None])
    sums = np.where(np.isfinite(both), grown, state.sums)
    count = state.count + 1
    return Sums(sums, np.where(sums == 0.0, count, state.since), count)


def evidence(state: Sums, thresholds: Thresholds) -> float:
    """The largest sum as a share of its threshold: an alarm from 1 on."""
    return float((state.sums / thresholds.levels[:, None, None]).max())


def alarm(state: Sums, thresholds: Thresholds) -> Alarm | None:
    """The series whose sum is farthest above its threshold; None where none is. All channels together count first."""
    share = state.sums / thresholds.levels[:, None, None]
    if share.max() < 1.0:
        return None
    a, side, series = np.unravel_index(int(share.argmax()), share.shape)
    return Alarm(int(series), bool(side == 0), int(state.since[a, side, series]))
