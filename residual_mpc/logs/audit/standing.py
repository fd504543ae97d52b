"""Stretches in which a robot on wheels stands still although it is told to drive: motors that are off, an emergency
stop, or a recording that begins before the robot is switched on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from residual_mpc.logs.run import FloatArray, Run
from residual_mpc.logs.signals import BoolArray, continuous, noise_sigma, resolution

LASTING = 1.0  # s: a dead time or a lag may take as long as most of that
DRIVING = 0.1  # of the fastest commands: above it the robot is told to drive
REACH = 0.25  # s on either side of a sample over which its speed is measured
STILL = 0.03  # of the usual fast speed: a robot that is slower stands still,
CERTAIN = 4.0  # or one that is slower than so many standard errors,
CLEAR = 0.25  # if these are no larger than this share of the fastest speed
SMALLER = 0.8  # of the commands in a stretch: as large ones move the robot elsewhere, for this share of the time,
USUAL = 0.9
MOVING = 2.0  # and smaller ones move it for this long, s
PLANE = ("pose.x", "pose.y", "pose.theta")


def standing(run: Run, wheels: Sequence[FloatArray]) -> list[tuple[int, int]]:
    """First and last row of each stretch. wheels: the commands (n,) of each wheel, as they are held.

    Smaller commands than those of a stretch have to move the robot at other times: a dead zone or friction holds it
    whenever they are that small.
    """
    if not wheels or not set(PLANE) <= set(run.measured):
        return []
    sent = np.max(np.abs(wheels), axis=0)
    still, driving = _still(run), sent > DRIVING * float(np.quantile(sent, 0.95))
    elsewhere, step = driving.copy(), np.diff(run.t, append=run.t[-1])
    trimmed = [_trimmed(driving, a, b) for a, b in _stretches(still)]
    found = [(a, b) for a, b in trimmed if float(step[a:b][driving[a:b]].sum()) >= LASTING]
    for a, b in found:
        elsewhere[a : b + 1] = False

    def seconds(mask: BoolArray) -> float:
        return float(step[mask & elsewhere].sum())

    out = []
    for a, b in found:
        usual = float(np.median(sent[a : b + 1][driving[a : b + 1]]))
        as_large, smaller = sent >= SMALLER * usual, sent <= usual
        if seconds(smaller & ~still) >= MOVING and seconds(as_large & ~still) > USUAL * seconds(as_large):
            out.append((a, b))
    return out


def _trimmed(mask: BoolArray, first: int, last: int) -> tuple[int, int]:
    """The first and the last row at which the mask holds from one row to another; an empty stretch where none is."""
    rows = np.flatnonzero(mask[first : last + 1])
    return (first + int(rows[0]), first + int(rows[-1])) if len(rows) else (first, first)


def _still(run: Run) -> BoolArray:
    """(n,) whether the pose stands still around each row; false where its samples do not tell. A heading that never
    changes, or a place, says nothing."""
    still, told = np.ones(len(run.t), dtype=bool), False
    for names in (PLANE[:2], PLANE[2:]):
        speeds, errors = zip(*(_speed(run, name) for name in names), strict=True)
        speed, error = np.linalg.norm(speeds, axis=0), CERTAIN * np.max(errors, axis=0)
        if not (np.isfinite(speed).any() and CLEAR * np.nanmax(speed) > np.nanmedian(error)):
            continue
        still &= speed < np.maximum(STILL * np.nanquantile(speed, 0.9), error)
        told = True
    return still & told


def _speed(run: Run, name: str) -> tuple[FloatArray, FloatArray]:
    """The slope of a line through the samples around each row, (n,) 1/s, and its standard error; NaN where there are
    fewer than three."""
    y = continuous(name, run.columns[name])
    there = np.isfinite(y)
    t, value = run.t[there], y[there]
    size = max(noise_sigma(run.t, y), resolution(value))
    first, last = (np.searchsorted(t, run.t + side * REACH) for side in (-1.0, 1.0))
    count = last - first

    def total(x: FloatArray) -> FloatArray:
        sums = np.concatenate([[0.0], np.cumsum(x)])
        return np.asarray(sums[last] - sums[first])

    enough = np.where(count >= 3, count, np.nan)
    mean = total(t) / enough
    spread = total(t * t) - enough * mean**2
    slope = (total(t * value) - mean * total(value)) / spread
    return slope, size / np.sqrt(spread)


def _stretches(mask: BoolArray) -> list[tuple[int, int]]:
    """First and last row of each stretch of true ones."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]])))
    return [(int(a), int(b) - 1) for a, b in edges.reshape(-1, 2)]
