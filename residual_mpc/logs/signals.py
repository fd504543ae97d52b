"""What one channel's samples say about its sensor: wrapping, rate, step, noise, spikes.

Every function takes one channel as an (n,) array in the channel's unit, NaN where a sample is missing, and t
as (n,) s, strictly increasing.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from residual_mpc.logs.by_content import by_content
from residual_mpc.logs.run import FloatArray
from residual_mpc.logs.window_polynomials import line_at_zero, quadratic

BoolArray = NDArray[np.bool_]

EQUAL = 1e-6  # of the period: stamps closer than this are next to equal
MAD_TO_SIGMA = 1.4826  # of a normal distribution
EVEN = 0.95  # share of a slower sensor's holds that are equally long, up to a sample
ONWARD = 0.05  # share of its holds after which the motion goes on as before; a third in pure noise
SLOWER = 0.1  # share of clear moves followed by a repeat, from which a sensor may be slower than its log
REGULAR = 0.8  # share of the holds with a repeat that follow each other at the same distance, up to a hold
MISSES = 0.02  # share of clear moves that a repeat parts, from which a sensor misses updates
FEWEST = 5  # of these repeats, below which a share says nothing
MISSED = 4  # updates in a row that a sensor misses at most; a motion that stands still for longer has paused
BURST = 3  # samples: the longest spike
FLANK = 0.3  # of a spike's height: the most that the samples beside it may share
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


def unwrap_with_gaps(y: FloatArray) -> FloatArray:
    """An angle without its jumps of 2 pi, (n,) rad; missing samples stay missing and are stepped over.

    Across a gap the nearest turn is taken, so a turn of more than pi within it cannot be seen.
    """
    out = np.array(y, dtype=np.float64)
    finite = np.isfinite(out)
    out[finite] = np.unwrap(out[finite])
    return out


def continuous(name: str, y: FloatArray) -> FloatArray:
    """A column (n,) without jumps of 2 pi where it may be an angle, as it is otherwise; name: of its channel."""
    return unwrap_with_gaps(y) if name == "pose.theta" or name.startswith("position.") else y


def fresh_samples(y: FloatArray) -> BoolArray:
    """Where a sample is neither missing nor a mere repeat of a slower sensor's last one, (n,).

    A channel counts as slower than its log only when clear moves, of several steps of its resolution, are
    followed by exact repeats, equally many each time; a quantised channel that creeps or stands still repeats
    itself at full rate. Without motion, one sample in each of the sensor's periods counts as fresh. Of a sensor
    that misses an update now and then, the few repeats between two moves in one direction are not fresh; whether
    it does is seen from moves of two steps and more.
    """
    fresh = np.isfinite(y)
    where = np.flatnonzero(fresh)
    values = y[where]
    if len(values) < 8:
        return fresh
    changes = np.flatnonzero(np.diff(values) != 0.0)  # the value at changes + 1 is new
    if len(changes) < 4:
        return fresh
    size = np.abs(np.diff(values)[changes])
    step = resolution(values)
    clear = size > max(3.0 * step, 0.5 * float(np.median(size)))
    period = _sensor_period(values, changes, clear)
    if period > 1:
        repeat = np.diff(values, prepend=np.nan) == 0.0
        last_change = np.maximum.accumulate(np.where(repeat, 0, np.arange(len(where))))
        fresh[where] = (np.arange(len(where)) - last_change) % period == 0
    else:
        found, share = _missed(values, changes, size > 1.5 * step)
        if share >= MISSES and found.sum() >= FEWEST:  # slow motion hides others among what a full rate repeats
            found, _ = _missed(values, changes, size > 0.0)
        fresh[where[found]] = False
    return fresh


def _missed(values: FloatArray, changes: NDArray[np.intp], clear: BoolArray) -> tuple[BoolArray, float]:
    """(n,) bool: the repeats between two clear moves in one direction, if there are few of them in a row; and how
    often there are any. changes: of the values, those that are clear."""
    moves, held = np.diff(values)[changes], np.diff(changes)
    onward = clear[:-1] & clear[1:] & (moves[:-1] * moves[1:] > 0.0) & (held <= 1 + MISSED)
    amid = onward & (held > 1)
    out = np.zeros(len(values), dtype=bool)
    for first, last in zip(changes[:-1][amid] + 2, changes[1:][amid] + 1, strict=True):
        out[first:last] = True
    return out, float(amid.sum() / max(onward.sum(), 1))


def _sensor_period(values: FloatArray, changes: NDArray[np.intp], clear: BoolArray) -> int:
    """How many samples a slower sensor holds its value while it moves; 1 for a sensor at full rate. changes: of the
    values, those that are clear."""
    # how long a value is held between two clear moves: creeping at either end would say nothing
    hold = np.diff(changes)[clear[:-1] & clear[1:]]
    held = np.flatnonzero(hold > 1)
    if len(hold) < 4 or len(held) < max(3.0, SLOWER * len(hold)):
        return 1
    # its clock beats with that of the log; a sensor that misses an update now and then does so at random
    apart = np.diff(held)
    if np.mean(np.abs(apart - np.median(apart)) <= 1) < REGULAR:
        return 1
    # a sensor holds its values for equally long; a motion that pauses now and then does not
    even = np.abs(hold - np.median(hold)) <= np.maximum(1.0, 0.25 * np.median(hold))
    # and it holds them on the way as well, not at turning points alone
    moves = np.diff(values)[changes]
    onward = (moves[:-1] * moves[1:] > 0.0)[clear[:-1] & clear[1:]]
    if np.mean(even) < EVEN or np.mean(onward[hold > 1]) < ONWARD:
        return 1
    return max(2, int(np.quantile(hold, 0.9, method="nearest")))


@by_content
def resolution(y: FloatArray) -> float:
    """The step of a quantised channel, in its unit; 0 where its values lie on no common grid.

    A grid finer than a few millionths of the largest values cannot be told from the rounding of 32-bit floats; a few
    that jump far away do not count among these.
    """
    values = np.unique(y[np.isfinite(y)])
    if len(values) < 2:
        return 0.0
    rounding = float(np.finfo(np.float32).eps * np.quantile(np.abs(values), 0.99))
    levels = values[np.append(True, np.diff(values) > 4.0 * rounding)]
    # a few levels fit some grid by chance, unless the samples return to them again and again
    if len(levels) < 2 or len(levels) < 6 and len(levels) > 0.25 * np.count_nonzero(np.isfinite(y)):
        return 0.0
    gaps = np.diff(levels)
    smallest = float(np.median(gaps[gaps < 1.5 * gaps.min()]))
    # where few levels are visited, the smallest gap may be several steps; many gaps rule out a grid by chance
    parts = range(1, 5) if len(gaps) >= 12 else (1,)
    return next((step for k in parts if (step := _grid(gaps, smallest / k, rounding)) > 0.0), 0.0)


def _grid(gaps: FloatArray, step: float, rounding: float) -> float:
    """The step near `step` of which all gaps are whole multiples, 0 if there is none."""
    for _ in range(2):  # the smallest gaps carry rounding; the whole range then refines the step
        counts = np.rint(gaps / step)
        if step < 40.0 * rounding or np.any(counts < 1.0):
            return 0.0
        off = np.abs(gaps - counts * step) > 0.05 * step + 2.0 * rounding
        if np.mean(off) > 0.05:
            return 0.0
        step = float(gaps[~off].sum() / counts[~off].sum())
    return step


@by_content
def noise_sigma(t: FloatArray, y: FloatArray) -> float:
    """A robust 1-sigma of a channel's white sensor noise, in its unit; 0 where it shows none.

    Differences of third, fifth and seventh order over consecutive fresh samples leave nothing of a motion
    that is locally a polynomial of one order less; white noise gives all three the same size, motion that is
    left over gives the lower orders more, so that the smallest counts. A quantised channel has at least the
    noise of its rounding, step / sqrt(12).

    What differences cannot see: coloured noise (slower than a few samples), drift, offsets, and stamps that
    are late by the same amount. Motion faster than a few samples and jitter of the stamps count as noise.
    """
    fresh = fresh_samples(y)
    t, y = t[fresh], y[fresh]
    found = [s for s in (difference_sigma(t, y, order) for order in (3, 5, 7)) if np.isfinite(s)]
    return max(min(found, default=0.0), resolution(y) / np.sqrt(12.0))


def difference_sigma(t: FloatArray, y: FloatArray, order: int) -> float:
    """1-sigma of white noise from normalised divided differences of fresh samples, which leave nothing of a motion that
    is locally a polynomial of one order less; NaN with fewer than eight of them."""
    if len(t) < order + 8:
        return float("nan")
    count = len(t) - order
    times = np.stack([t[i : i + count] for i in range(order + 1)])  # (order + 1, m)
    values = np.stack([y[i : i + count] for i in range(order + 1)])
    period = float(np.median(np.diff(t)))
    apart = np.diff(times, axis=0)
    even = (apart.max(axis=0) < 3.0 * period) & (apart.min(axis=0) > EQUAL * period)  # not across a gap
    if np.count_nonzero(even) < 8:
        return float("nan")
    times, values = (times[:, even] - times[0, even]) / period, values[:, even] - values[0, even]
    weights = np.ones_like(times)
    for i, j in itertools.permutations(range(order + 1), 2):
        weights[i] *= times[i] - times[j]
    weights = 1.0 / weights
    weights /= np.sqrt(np.sum(weights**2, axis=0))
    return float(MAD_TO_SIGMA * np.median(np.abs(np.sum(weights * values, axis=0))))


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
