"""Rows that were taken evenly and stamped when several of them arrived at once, as a serial port or a network hands
them over."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from residual_mpc.logs.finding import Finding
from residual_mpc.logs.run import FloatArray, Run
from residual_mpc.logs.signals import BoolArray, continuous

AT_ONCE = 0.2  # of the usual time between rows, below which two rows belong to one burst
OFTEN, LONG = 0.95, 5.0  # times this quantile of the times between rows, above which one is a pause
EVEN = 0.3  # of a channel's change from burst to burst, that from row to row within one must exceed: it moved on
PAUSE = 1.5  # times a burst's rows in periods, above which rows are missing before it
WHOLE = 0.9  # share of the rows that a column must fill: rows of several topics lie close together too
FEWEST = 40  # rows
REACH = 10  # bursts on either side, whose stamps tell where the clock is


def without_bursts(runs: Sequence[Run]) -> tuple[tuple[Run, ...], tuple[Finding, ...]]:
    """The runs with evenly spaced stamps in each burst that end at its last row, and which they are.

    More than half of the rows must come in bursts, and the measured motion must go on within a burst as it does from
    one to the next: rows that were really taken together hardly differ.
    """
    dated = [_dated(run) for run in runs]
    out = tuple(
        run if t is None else replace(run, t=t - t[0], start=run.start + t[0])
        for run, t in zip(runs, dated, strict=True)
    )
    changed = [run for run, t in zip(runs, dated, strict=True) if t is not None]
    if not changed:
        return out, ()
    rows = max(float(np.median(np.diff(_ends(np.diff(run.t))))) for run in changed)
    where = "" if len(changed) == 1 else f"in {len(changed)} of {len(runs)} runs "
    text = (
        f"{where}the rows are stamped in bursts of about {rows:.0f}, though the measured motion goes on evenly within"
        " them; their time stamps are spaced evenly instead"
    )
    remedy = "write the time at which a sample is taken, not the time at which it arrives"
    name = changed[0].name if len(changed) == 1 else ""
    return out, (Finding("warning", "bursts", name, "t", None, text, remedy),)


def _usual(steps: FloatArray) -> BoolArray:
    """(n - 1,) bool: which of the times between rows are no pauses."""
    return np.asarray(steps <= LONG * np.quantile(steps, OFTEN))


def _at_once(steps: FloatArray) -> BoolArray:
    """(n - 1,) bool: after which rows the next one comes in the same burst."""
    return np.asarray(steps < AT_ONCE * steps[_usual(steps)].mean())


def _ends(steps: FloatArray) -> np.ndarray:
    """The last row of each burst, from the times between rows (n - 1,) s."""
    return np.append(np.flatnonzero(~_at_once(steps)), len(steps))


def _dated(run: Run) -> FloatArray | None:
    """(n,) s, or None where the rows do not come in bursts or were taken as they are stamped."""
    steps = np.diff(run.t)
    if len(run.t) < FEWEST or _at_once(steps).mean() <= 0.5 or not _moves_on(run, steps):
        return None
    ends = _ends(steps)
    rows = np.diff(ends)  # of each burst but the first
    passed = np.diff(run.t[ends])
    usual = passed <= PAUSE * rows * np.median(passed / rows)
    period = float(passed[usual].sum() / rows[usual].sum())
    ticks = np.ones(len(run.t))
    ticks[0] = 0.0
    ticks[ends[:-1] + 1] += np.where(usual, 0.0, np.round(passed / period - rows))  # before a burst that is late
    at = np.cumsum(ticks)
    late = run.t[ends] - period * at[ends]  # of the clock's ticks, at the ends of the bursts
    shift = np.array([late[max(k - REACH, 0) : k + REACH + 1].mean() for k in range(len(late))])
    t = period * at + np.interp(at, at[ends], shift)
    return t if (np.diff(t) > 0.0).all() else None


def _moves_on(run: Run, steps: FloatArray) -> bool:
    """Whether the measured channels change within bursts about as much as from one to the next, in the median."""
    within = _at_once(steps)
    between = _usual(steps) & ~within
    shares = []
    for name in run.measured:
        if np.mean(np.isfinite(run.columns[name])) < WHOLE:
            return False
        change = np.abs(np.diff(continuous(name, run.columns[name])))
        inside, across = (
            float(np.nanmean(change[w])) if np.isfinite(change[w]).any() else 0.0 for w in (within, between)
        )
        if across > 0.0:
            shares.append(inside / across)
    return bool(shares) and float(np.median(shares)) > EVEN
