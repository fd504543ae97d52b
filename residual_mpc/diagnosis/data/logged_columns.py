"""Logged columns that are no channel of the robot, such as a temperature or a supply voltage. A prediction knows their
value at its start."""

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.errors import BadInput
from residual_mpc.logs.run import Run

OVER = 1.0  # s before a start, over which a column's samples are averaged
AGE = 10.0  # s between a start and the sample that stands for it, at most
FORETOLD = 0.8  # share of the variance of its means over the windows that the values at their starts have to explain
STEADY = 0.7  # share of the variance of its samples that lies between windows and not within them
CLOCKLIKE = 0.9999  # squared correlation with the time in a run, above which a column counts and measures nothing
WITHIN = 0.03  # share of the variance within runs, below which a column counts as one value a run
RUNS = 5  # that such a column has to differ between


def at_starts(data: Dataset, column: str, where: slice = slice(None)) -> np.ndarray:
    """(W,) the mean of a column's samples in the last second before the start of each window in `where`, else the last
    sample before it, or the first of a run that begins with it. NaN where that is more than AGE away.

    Raises BadInput for a run without it.
    """
    run, start = data.run[where], data.start[where]
    out = np.empty(len(run))
    for i in np.unique(run):
        mine = run == i
        out[mine] = _before(data.runs[i], column, start[mine])
    return out


def foreknown_columns(data: Dataset) -> tuple[str, ...]:
    """The logged columns that all runs have, that change, and whose value at a window's start says what they are in
    it. A column that follows the motion is none, nor is a count of rows."""
    names = [c for c in data.runs[0].extra_columns if all(_there(run, c) for run in data.runs)]
    return tuple(c for c in names if _foreknown(data, c))


def _before(run: Run, column: str, start: np.ndarray) -> np.ndarray:
    if not _there(run, column):
        raise BadInput(
            f"run {run.name} has no numbers in the column {column!r}, which a law of the model depends on",
            run.source or run.name,
            f"log {column}, or use a model without that law: `residual-mpc diagnose --without fitted_law`",
        )
    y = run.extra_columns[column]
    good = np.isfinite(y)
    t, y = run.t[good], y[good]
    middle = float(np.mean(y))  # a sum of large numbers would lose their small differences
    total = np.concatenate([[0.0], np.cumsum(y - middle)])
    last = np.searchsorted(t, start + 1e-9, side="right")
    first = np.searchsorted(t, start - OVER - 1e-9)
    count = last - first
    at = np.clip(last - 1, 0, len(y) - 1)
    nearest = np.where(np.abs(t[at] - start) <= AGE, y[at], np.nan)
    return np.where(count > 0, middle + (total[last] - total[first]) / np.maximum(count, 1), nearest)


def _there(run: Run, column: str) -> bool:
    values = run.extra_columns.get(column)
    return values is not None and bool(np.isfinite(values).any())


def _foreknown(data: Dataset, column: str) -> bool:
    known = at_starts(data, column)
    if not np.isfinite(known).all():
        return False
    mean, within = _in_windows(data, column)
    seen = np.isfinite(mean)
    if seen.sum() < 3 or np.var(mean[seen]) <= 1e-12 * (1.0 + np.mean(mean[seen]) ** 2):
        return False
    between = float(np.var(mean[seen]))
    left = float(np.mean((mean[seen] - known[seen]) ** 2))
    if 1.0 - left / between < FORETOLD or between / (between + float(np.nanmean(within))) < STEADY:
        return False
    return not _counts(data, column) and _varies(data, known)


def _in_windows(data: Dataset, column: str) -> tuple[np.ndarray, np.ndarray]:
    """(W,) mean and variance of a column's samples within each window; NaN where it has none."""
    mean, within = np.full(data.count, np.nan), np.full(data.count, np.nan)
    for w, i in enumerate(data.run):
        run = data.runs[i]
        a, b = np.searchsorted(run.t, [data.start[w] - 1e-9, data.start[w] + data.horizon + 1e-9])
        y = run.extra_columns[column][a:b]
        y = y[np.isfinite(y)]
        if len(y):
            mean[w], within[w] = float(np.mean(y)), float(np.var(y))
    return mean, within


def _counts(data: Dataset, column: str) -> bool:
    """Whether a column is a straight line in time in every run, as a row number or another clock is."""
    for run in (data.runs[i] for i in np.unique(data.run)):
        y = run.extra_columns[column]
        good = np.isfinite(y)
        if good.sum() < 3 or np.ptp(y[good]) == 0.0 or np.corrcoef(run.t[good], y[good])[0, 1] ** 2 < CLOCKLIKE:
            return False
    return True


def _varies(data: Dataset, known: np.ndarray) -> bool:
    """Whether a column changes within runs, or has values in so many runs that one of them cannot make a law."""
    runs = np.unique(data.run)
    means = np.array([known[data.run == i].mean() for i in runs])
    inside = float(np.mean([known[data.run == i].var() for i in runs]))
    return inside > WITHIN * float(np.var(known)) or len(np.unique(np.round(means, 9))) >= RUNS
