"""Rows that an evenly written log has lost, and the commands that were sent in them.

A recorder that drops a row drops the command in it, but the robot followed that command. Between two rows of a command
that changes steadily, the lost one lay between them; taking the one before for it makes an error that a precise model
shows as a gap. A loop that is late now and then has lost nothing: its pauses are no whole numbers of periods, and
its commands were held.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from residual_mpc.logs.columns import PER_ACTUATOR, group
from residual_mpc.logs.even_clock import PAUSE, ticks
from residual_mpc.logs.finding import Finding
from residual_mpc.logs.run import FloatArray, Run

UNEVEN = 0.05  # of the period, and 1.5 times what is usual, by which pauses may be off whole numbers of periods
MOST_UNEVEN = 0.2  # of the period, at the most: half of them are off by less than a quarter by chance
WHOLE = 0.9  # share of the rows that a column must fill, for its rows to be those of the log
MANY = 0.3  # share of the rows after another time than a period, above which rows are not written by a clock
STEADY = 3.0  # times the changes before and after, up to which a change over lost rows is steady
FEWEST, MOST = 20, 2_000_000  # rows


def with_lost_rows(runs: Sequence[Run]) -> tuple[tuple[Run, ...], tuple[Finding, ...]]:
    """The runs with a row for each that was lost, and which they are. The new rows hold no measurement; a command in
    them is interpolated where it changes steadily, and is else the one before."""
    lost = [_lost(run) for run in runs]
    out = tuple(_filled(run, *where) if len(where[0]) else run for run, where in zip(runs, lost, strict=True))
    found = [i for i, (before, _) in enumerate(lost) if len(before)]
    if not found:
        return out, ()
    counts = [lost[i][1] for i in found]
    missing, most = sum(int(c.sum()) for c in counts), max(int(c.max()) for c in counts)
    whole = sum(len(out[i].t) for i in found)
    text = f"{missing} of {whole} rows are missing{f', up to {most} of them together' if most > 1 else ''}"
    text += "; commands in them are interpolated"
    if len(found) > 1:
        return out, (Finding("info", "lost rows", "", "t", None, f"in {len(found)} of {len(runs)} runs {text}"),)
    return out, (Finding("info", "lost rows", out[found[0]].name, "t", int(lost[found[0]][0][0]), text),)


def _lost(run: Run) -> tuple[np.ndarray, np.ndarray]:
    """The rows after which some are lost, and how many each; none in a log that is not written evenly, or that is
    joined from several sources."""
    none = np.zeros(0, dtype=int), np.zeros(0, dtype=int)
    n, step = len(run.t), np.diff(run.t)
    used = [values for name, values in run.columns.items() if group(name) == "command" or name in run.measured]
    if not FEWEST <= n <= MOST or any(np.mean(np.isfinite(values)) < WHOLE for values in used):
        return none
    period = float(np.median(step))
    passed, nearest = np.diff(ticks(run.t, period)[0]), np.round(step / period)
    off = np.abs(step / period - nearest)
    before = np.flatnonzero((step < PAUSE * period) & (nearest > 1.0) & (passed == nearest))
    most = min(UNEVEN + 1.5 * float(np.median(off[nearest == 1.0])), MOST_UNEVEN)
    if not len(before) or np.median(off[before]) > most or np.mean(nearest != 1.0) > MANY:
        return none
    return before, nearest[before].astype(int) - 1


def _filled(run: Run, before: np.ndarray, count: np.ndarray) -> Run:
    """The run with `count` more rows after each of the rows `before`, evenly spaced."""
    at = np.repeat(before, count)
    place = np.concatenate([np.arange(1, k + 1) for k in count]) / np.repeat(count + 1, count)

    def grown(values: FloatArray, new: FloatArray) -> FloatArray:
        return np.insert(values, at + 1, new)

    def column(name: str, values: FloatArray) -> FloatArray:
        if group(name) not in PER_ACTUATOR:
            return grown(values, np.full(len(at), np.nan))
        change = np.where(_steady(values, at) & (group(name) == "command"), values[at + 1] - values[at], 0.0)
        return grown(values, values[at] + place * change)

    return replace(
        run,
        t=grown(run.t, run.t[at] + place * (run.t[at + 1] - run.t[at])),
        columns={name: column(name, values) for name, values in run.columns.items()},
        extra_columns={name: grown(values, np.full(len(at), np.nan)) for name, values in run.extra_columns.items()},
    )


def _steady(values: FloatArray, at: np.ndarray) -> np.ndarray:
    """(k,) bool: where a command (n,) changes over the rows `at` (k,) and the next by no more than it does around."""
    last = len(values) - 1
    around = np.abs(values[at] - values[np.maximum(at - 1, 0)])
    around = around + np.abs(values[np.minimum(at + 2, last)] - values[at + 1])
    return np.asarray(np.abs(values[at + 1] - values[at]) <= STEADY * around)
