"""What one channel's samples say about its sensor: wrapping, rate, step, noise.

Every function takes one channel as an (n,) array in the channel's unit, NaN where a sample is missing, and t
as (n,) s, strictly increasing.
"""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from residual_mpc.logs.by_content import by_content
from residual_mpc.logs.run import FloatArray

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
