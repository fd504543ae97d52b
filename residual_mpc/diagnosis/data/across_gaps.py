"""Windows across a gap in a log: commands may be lost in it, so that a replay says nothing of the model."""

from collections.abc import Sequence

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.hold_out import KeptBack
from residual_mpc.logs.run import Run
from residual_mpc.logs.time_gaps import time_gaps

AFTER = 0.3  # s after a gap in which delays and lags still pass on what was sent in it
SLACK = 1e-6  # s

Spans = Sequence[tuple[float, float]]


def unknown_spans(run: Run) -> list[tuple[float, float]]:
    """s: the gaps of a run, each until what was sent in it is forgotten, in order."""
    return [(float(begin), float(end) + AFTER) for begin, end in time_gaps(run)]


def clear_of_gaps(run: Run, starts: np.ndarray, horizon: float) -> np.ndarray:
    """(W,) bool: which windows that begin at starts (W,) s share no more than a moment with an unknown span."""
    out = np.ones(len(starts), dtype=bool)
    for begin, end in unknown_spans(run):
        out &= (starts >= end - SLACK) | (starts + horizon <= begin + SLACK)
    return out


def across_gaps(data: Dataset) -> np.ndarray:
    """(W,) bool: the windows across a gap; none where all of them are."""
    clear = np.ones(data.count, dtype=bool)
    for i in np.unique(data.run):
        mine = data.run == i
        clear[mine] = clear_of_gaps(data.runs[int(i)], data.start[mine], data.horizon)
    return ~clear if clear.any() else ~np.ones_like(clear)


def between_gaps(data: Dataset, kept: Sequence[KeptBack]) -> tuple[KeptBack, ...]:
    """What is kept back, less the windows across gaps: a run or block with such windows is the blocks between them."""
    lost, names = across_gaps(data), [run.name for run in data.runs]
    out: list[KeptBack] = []
    for k in kept:
        mine = data.run == names.index(k.run) if k.run in names else np.zeros(data.count, dtype=bool)
        if k.start is not None and k.end is not None:
            mine &= (data.start >= k.start - SLACK) & (data.start + data.horizon <= k.end + SLACK)
        out += [k] if not (mine & lost).any() else _blocks(k.run, data.start[mine & ~lost], data.horizon)
    return tuple(out)


def _blocks(run: str, starts: np.ndarray, horizon: float) -> list[KeptBack]:
    """Blocks of neighbouring windows."""
    starts = np.sort(starts)
    parts = np.split(starts, np.flatnonzero(np.diff(starts) > 1.5 * horizon) + 1) if len(starts) else []
    return [KeptBack(run, float(p[0]), float(p[-1] + horizon)) for p in parts]
