"""Robots on wheels that do not do what they are told: standing still although told to drive (motors that are off, an
emergency stop, a recording that begins before the robot is switched on), or driving off although told to stand (someone
carries or pushes it)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from residual_mpc.logs.audit.pose_speed import PLANE, pose_speeds
from residual_mpc.logs.run import FloatArray, Run
from residual_mpc.logs.signals import BoolArray

LASTING = 1.0  # s: a dead time or a lag may take as long as most of that
DRIVING = 0.1  # of the fastest commands: above it the robot is told to drive
STILL = 0.03  # of the usual fast speed: a robot that is slower stands still
SMALLER = 0.8  # of the commands in a stretch: as large ones move the robot elsewhere, for this share of the time,
USUAL = 0.9
MOVING = 2.0  # and smaller ones move it for this long, s
TOLD_TO_STAND = 0.01  # of the fastest commands: below it the robot is told to stand
SETTLED = 0.5  # s after which a robot that is told to stand has stopped
MOVED, MOVED_FOR = 0.1, 0.3  # of the usual fast speed, and s: at least that much is no creeping
SET_OFF = 0.3  # of the fastest speed of such a stretch: it begins slower; a slope or a slow stop does not


def standing(run: Run, wheels: Sequence[FloatArray]) -> list[tuple[int, int]]:
    """First and last row of each stretch in which the robot stands still although it is told to drive. wheels: the
    commands (n,) of each wheel, as they are held.

    Smaller commands than those of a stretch have to move the robot at other times: a dead zone or friction holds it
    whenever they are that small.
    """
    speeds = _speeds(run, wheels)
    if not speeds:
        return []
    still = np.ones(len(run.t), dtype=bool)
    for speed, error in speeds:
        still &= speed < np.maximum(STILL * np.nanquantile(speed, 0.9), error)
    sent = np.max(np.abs(wheels), axis=0)
    driving = sent > DRIVING * float(np.quantile(sent, 0.95))
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


def carried(run: Run, wheels: Sequence[FloatArray]) -> list[tuple[int, int]]:
    """First and last row of each stretch in which the robot sets off although it is told to stand."""
    speeds = _speeds(run, wheels)
    if not speeds:
        return []
    sent = np.max(np.abs(wheels), axis=0)
    out = []
    for a, b in _stretches(sent < TOLD_TO_STAND * float(np.quantile(sent, 0.95))):
        rest = a + int(np.searchsorted(run.t[a : b + 1], run.t[a] + (SETTLED if a else 0.0)))
        for speed, error in speeds:
            fast = np.maximum(MOVED * np.nanquantile(speed, 0.9), 2.0 * error)
            for c, d in _stretches(speed[rest : b + 1] > fast[rest : b + 1]):
                first, last = rest + c, rest + d
                begins = np.nanmin(speed[rest : first + 1])
                lasts = run.t[last] - run.t[first] >= MOVED_FOR
                if lasts and begins < SET_OFF * np.nanmax(speed[first : last + 1]):
                    out.append((max(rest, first - 1), last))
    return _joined(sorted(out))


def _speeds(run: Run, wheels: Sequence[FloatArray]) -> list[tuple[FloatArray, FloatArray]]:
    return pose_speeds(run) if len(wheels) and set(PLANE) <= set(run.measured) else []


def _joined(spans: Sequence[tuple[int, int]]) -> list[tuple[int, int]]:
    """Spans of rows, in order, those that meet as one."""
    out: list[tuple[int, int]] = []
    for a, b in spans:
        if out and a <= out[-1][1] + 1:
            out[-1] = (out[-1][0], max(out[-1][1], b))
        else:
            out.append((a, b))
    return out


def _trimmed(mask: BoolArray, first: int, last: int) -> tuple[int, int]:
    """The first and the last row at which the mask holds from one row to another; an empty stretch where none is."""
    rows = np.flatnonzero(mask[first : last + 1])
    return (first + int(rows[0]), first + int(rows[-1])) if len(rows) else (first, first)


def _stretches(mask: BoolArray) -> list[tuple[int, int]]:
    """First and last row of each stretch of true ones."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]])))
    return [(int(a), int(b) - 1) for a, b in edges.reshape(-1, 2)]
