"""Samples of a channel that lie off the curve of their neighbours: outliers, and samples whose stamps are late."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from residual_mpc.logs.run import FloatArray
from residual_mpc.logs.signals import BoolArray, fresh_samples, resolution
from residual_mpc.logs.window_polynomials import line_at_zero, quadratic

BURST = 3  # samples: the longest spike
FLANK = 0.3  # largest deviation of the samples beside a spike, relative to its height
REACH = 11  # samples in the window of a local polynomial
STRETCH = 61  # samples over which errors of prediction are usual
SPIKE = 6.0  # times the noise, and times the local error of prediction
PAUSE = 1.3  # periods between two stamps, above which the later sample may have been stamped late
LONGEST_PAUSE = 4.0  # periods by which it may be late
ON_GRID = 0.01  # of a period: a pause that is this near to whole periods is one of lost samples, stamped in time
STAMP = 0.1  # of the period: how far any stamp may be off; one that is early by more is rather late by the rest


@dataclass(frozen=True)
class Jumps:
    """Samples of a channel that lie off the curve of their neighbours.

    Attributes:
        outlier: (n,) bool: no time at which the sample may have been taken puts it on the curve.
        late: (n,) s: by how much the stamp is late where another time does; NaN elsewhere.
    """

    outlier: BoolArray
    late: FloatArray


def spikes(t: FloatArray, y: FloatArray, sigma: float) -> BoolArray:
    """The samples that jump away and come back within three samples, (n,): the outliers of `find_jumps`."""
    return find_jumps(t, y, sigma).outlier


def find_jumps(t: FloatArray, y: FloatArray, sigma: float) -> Jumps:
    """The samples that jump away and come back within three samples, and those whose stamps are late instead.

    An outlier lies off a robust quadratic through its eleven nearest fresh samples, and off the line of either
    side continued to it, by more than six sigma of the noise, of the quadratic's errors at its neighbours,
    and of what is usual in that stretch, so that fast motion, steps and corners are none. The first and the
    last three samples of a run cannot be seen to come back, and are never flagged.

    While a robot moves with v, a sample whose stamp is late by d lies v d behind the curve. How late it may be is
    seen from the stamps: by how much they leave the even grid of their neighbours, and a tenth of the period that no
    stamp shows; after a pause between stamps, by up to the pause. A deviation that such a shift explains is not an
    outlier.

    Args:
        t: (n,) s.
        y: (n,).
        sigma: 1-sigma noise of the channel, in its unit; see `noise_sigma`.
    """
    out = Jumps(np.zeros(len(y), dtype=bool), np.full(len(y), np.nan))
    where = np.flatnonzero(fresh_samples(y))
    if len(where) < REACH:
        return out
    floor = max(SPIKE * sigma, 3.0 * resolution(y[where]))
    for part in np.array_split(where, max(1, len(where) // 100_000)):
        first, last = np.searchsorted(where, [part[0], part[-1]])
        around = where[max(0, first - STRETCH) : last + 1 + STRETCH]  # no trace of the cuts
        found = _jumps(t[around], y[around], floor)
        mine = slice(first - np.searchsorted(where, around[0]), None)
        out.outlier[part] = found.outlier[mine][: len(part)]
        out.late[part] = found.late[mine][: len(part)]
    return out


def _jumps(t: FloatArray, y: FloatArray, floor: float) -> Jumps:
    """The jumps among consecutive fresh samples; floor is the smallest that counts."""
    n = len(t)
    first = np.clip(np.arange(n) - REACH // 2, 0, n - REACH)
    window = first[:, None] + np.arange(REACH)  # (n, REACH)
    own = window == np.arange(n)[:, None]
    tau = t[window] - t[:, None]
    reach = np.abs(tau).max(axis=1)  # (n,) s
    tau /= reach[:, None]
    square = tau * tau
    powers = np.stack([np.ones_like(tau), tau, square, square * tau, square * square])  # (5, n, REACH)
    values = y[window] - y[:, None]  # about the sample itself, for the sake of the digits
    # start: distance from the window's median, which three bad samples of eleven cannot move away
    error = values - _ranked(values, REACH // 2)
    for _ in range(6):  # reweighted least squares, without the sample itself
        scale = _ranked(np.abs(error), REACH // 2) + 0.1 * floor + 1e-300
        weight = np.where(own, 0.0, 1.0 / (1.0 + np.minimum(np.abs(error) / scale, 1e6) ** 2))
        fit, slope = quadratic(powers, values, weight)
        error = values - fit
    away = error[own]  # (n,) one own sample a window
    nearest = np.abs(away)
    for side in (tau < 0.0, tau > 0.0):  # at a corner one side's line, continued, meets the sample
        line = -line_at_zero(powers, values, weight * side)
        seen = np.count_nonzero(side, axis=1) >= 3
        nearest = np.where(seen, np.minimum(nearest, np.where(line * away > 0.0, np.abs(line), 0.0)), nearest)
    others = np.where(own, np.inf, np.abs(error))
    local = _ranked(others, REACH - 2 - BURST)[:, 0]  # the largest three of the ten neighbours may be spikes themselves
    usual = _running_quantile(np.abs(away), 0.8) / 1.28  # 1 sigma of normal errors, with room for 20 % spikes
    threshold = np.maximum(floor, SPIKE * np.maximum(local, usual))
    slope /= reach
    jump = np.minimum(nearest, _unexplained(away, slope, t[window], np.arange(n) - first)) > threshold
    late = np.where((nearest > threshold) & ~jump, -away / np.where(slope == 0.0, np.inf, slope), np.nan)
    jump[:3] = jump[-3:] = False
    place = np.arange(n) - first
    before, after = (np.abs(error[np.arange(n), np.clip(place + k, 0, REACH - 1)]) for k in (-1, 1))
    return Jumps(_bursts(jump, before < FLANK * np.abs(away), after < FLANK * np.abs(away)), late)


def _ranked(x: FloatArray, place: int) -> FloatArray:
    """(n, 1) the value at that place of each sorted row of x (n, REACH), without NaN; the median in the middle."""
    return np.partition(x, place, axis=1)[:, place, None]


def _unexplained(away: FloatArray, slope: FloatArray, times: FloatArray, place: NDArray[np.intp]) -> FloatArray:
    """How far each sample is off its curve at the best of the times at which it may have been taken, (n,).

    Args:
        away: (n,) how far it is off at its stamp.
        slope: (n,) of the curve, 1/s.
        times: (n, k) s, the stamps around each.
        place: (n,) of the sample among them.
    """
    late, period = _lateness(times, place)
    margin = np.abs(slope) * STAMP * period
    # a sample may have been taken before a pause and stamped after it
    own = np.arange(len(times))
    since = times[own, place] - times[own, np.maximum(place - 1, 0)]
    held_up = (since > PAUSE * period) & (np.abs(since / period - np.rint(since / period)) > ON_GRID)
    paused = np.where(held_up, np.minimum(since - period, LONGEST_PAUSE * period), 0.0)
    shifts = np.stack([np.zeros_like(late), -slope * late, -slope * np.maximum(late, paused)])
    low, high = shifts.min(axis=0) - margin, shifts.max(axis=0) + margin
    left = np.maximum(0.0, np.maximum(low - away, away - high))
    by_the_rest = np.maximum(0.0, np.abs(away + slope * (late + period)) - margin)
    return np.where(late < -STAMP * period, np.minimum(left, by_the_rest), left)


def _lateness(times: FloatArray, place: NDArray[np.intp]) -> tuple[FloatArray, FloatArray]:
    """By how much a stamp is later than on the even grid of the stamps around it, and the grid's period, (n,) s."""
    middle = (times.shape[1] - 2) // 2
    period = np.partition(np.diff(times, axis=1), middle, axis=1)[:, middle]
    since = times[np.arange(len(times)), place][:, None] - times  # (n, k) s: whole periods on an even grid
    off = since / period[:, None]
    # half a period late is half a period early to some neighbours, by rounding: take the turn that they agree on
    turns = np.stack([off - np.rint(off), off - np.floor(off)])  # (2, n, k)
    median = np.median(turns, axis=2)  # (2, n)
    spread = np.abs(turns - median[:, :, None]).sum(axis=2)
    late = np.where(spread[0] <= spread[1], median[0], median[1] - (median[1] > 0.5))
    return late * period, period


def _running_quantile(x: FloatArray, share: float) -> FloatArray:
    """The quantile over the `STRETCH` samples around each, (n,)."""
    reach = min(STRETCH, len(x))
    k = int(share * (reach - 1))
    ranked = np.partition(np.lib.stride_tricks.sliding_window_view(x, reach), k, axis=1)[:, k]
    return ranked[np.clip(np.arange(len(x)) - reach // 2, 0, len(ranked) - 1)]


def _bursts(flags: BoolArray, rises: BoolArray, falls: BoolArray) -> BoolArray:
    """The flags in bursts of at most `BURST` that begin and end sharply; a quick motion has flanks."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    out = np.zeros(len(flags), dtype=bool)
    for start, stop in edges.reshape(-1, 2):
        out[start:stop] = stop - start <= BURST and rises[start] and falls[stop - 1]
    return out
