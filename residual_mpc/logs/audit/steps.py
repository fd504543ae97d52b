"""Steps of a position that no motion makes: a localisation or an encoder that jumps and stays, or freezes and then
catches up."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from residual_mpc.logs.run import FloatArray
from residual_mpc.logs.signals import fresh_samples, noise_sigma, resolution

AROUND = 5  # changes on either side of a step that tell how large steps are there
LARGER = 3.0  # times the largest of them
NOISE = 10.0  # times the noise, and steps of the resolution
FASTER = 1.2  # times the speed that the channel exceeds in one sample of two hundred: no motion is that fast
LATE = 1.5  # times the fastest speed around, at which it passes this and the last change: no sample was stamped late
FROZEN, FEWEST = 0.3, 5  # s and samples: the shortest repetition that counts as frozen
LONGER = 5.0  # times the usual time between changes
STAYS = 5  # samples after a step that tell whether it stays; an outlier comes back
REMAINS = 0.5  # share of a step that has to remain


@dataclass(frozen=True)
class Step:
    """A change between two rows that no motion makes. first, last: the rows; size: in the channel's unit; frozen:
    whether the rows before the last repeat the first one's value."""

    first: int
    last: int
    size: float
    frozen: bool


def steps_of(t: FloatArray, y: FloatArray) -> list[Step]:
    """The steps of a channel without jumps of 2 pi, y (n,), NaN where missing; t (n,) s."""
    there = np.flatnonzero(fresh_samples(y))
    at, value = t[there], y[there]
    changed = np.flatnonzero(np.diff(value) != 0.0) + 1  # of `there`: the samples that differ from the one before
    if len(changed) < 4 * AROUND:
        return []
    size = value[changed] - value[changed - 1]
    since = np.diff(at[changed], prepend=at[0])  # s since the change before
    gap = at[changed] - at[changed - 1]  # s since the sample before
    repeats = np.diff(changed, prepend=0)
    usual = float(np.median(since))
    fastest = float(np.quantile(np.abs(size) / gap, 0.995))
    least = NOISE * max(noise_sigma(t, y), resolution(y))
    frozen = (since > max(FROZEN, LONGER * usual)) & (repeats >= FEWEST)
    together = np.abs(size + _before(size)) / (since + _before(since))
    sudden = (gap < 1.5 * float(np.median(gap))) & (np.abs(size) / gap > FASTER * fastest)
    sudden &= together > LATE * _largest_around(np.abs(size) / gap)
    large = np.abs(size) > np.maximum(LARGER * _largest_around(np.abs(size)), least)
    out = []
    for k in np.flatnonzero(large & (frozen | sudden)):
        if _stays(value, int(changed[k]), float(size[k])):
            held_from = changed[k - 1] if k else 0
            first = held_from if frozen[k] else changed[k] - 1
            out.append(Step(int(there[first]), int(there[changed[k]]), float(size[k]), bool(frozen[k])))
    return out


def _before(x: FloatArray) -> FloatArray:
    """(n,) the value before each, 0 before the first."""
    return np.concatenate([[0.0], x[:-1]])


def _largest_around(size: FloatArray) -> FloatArray:
    """(n,) the largest of the `AROUND` sizes on either side of each, without itself."""
    padded = np.pad(size, AROUND, constant_values=0.0)
    view = np.lib.stride_tricks.sliding_window_view(padded, 2 * AROUND + 1)
    own = np.arange(2 * AROUND + 1) == AROUND
    return np.asarray(np.where(own, 0.0, view).max(axis=1))


def _stays(value: FloatArray, at: int, size: float) -> bool:
    """Whether the samples after a step differ from those before it by about as much, in its direction."""
    before, after = value[max(0, at - STAYS) : at], value[at : at + STAYS]
    return len(after) == STAYS and bool((np.median(after) - np.median(before)) * np.sign(size) > REMAINS * abs(size))
