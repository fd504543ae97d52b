"""Windows that no fit sees: across a gap in the log, in which commands may be lost, or an incident, or without a
measured start."""

from collections.abc import Sequence

import numpy as np

from residual_mpc.diagnosis.data.dataset import POSITION_LIKE, Dataset
from residual_mpc.diagnosis.data.hold_out import KeptBack
from residual_mpc.logs.run import Run
from residual_mpc.logs.time_gaps import time_gaps

AFTER = 0.3  # s after such a stretch in which delays and lags still pass on what was sent in it
FAR = 1.5  # periods of a channel: farther from its nearest sample, a window's start is not measured but extrapolated
SLACK = 1e-6  # s

Spans = Sequence[tuple[float, float]]


def gap_spans(run: Run) -> Spans:
    """s: the gaps of a run, each until what was sent in it is forgotten."""
    return [(float(begin), float(end) + AFTER) for begin, end in time_gaps(run)]


def unfit_spans(run: Run) -> Spans:
    """s: the gaps and incidents of a run, each until what was sent in it is forgotten, in order."""
    return sorted([*gap_spans(run), *((begin, end + AFTER) for begin, end in run.incidents)])


def clear_of(spans: Spans, starts: np.ndarray, horizon: float) -> np.ndarray:
    """(W,) bool: which windows that begin at starts (W,) s share no more than a moment with any of the spans."""
    out = np.ones(len(starts), dtype=bool)
    for begin, end in spans:
        out &= (starts >= end - SLACK) | (starts + horizon <= begin + SLACK)
    return out


def untold(data: Dataset) -> np.ndarray:
    """(W,) bool: the windows across a gap or without a measured start, which say nothing of a model."""
    return _left_out(data, [gap_spans(run) for run in data.runs])


def unfit(data: Dataset) -> np.ndarray:
    """(W,) bool: these and the windows across an incident."""
    return _left_out(data, [unfit_spans(run) for run in data.runs])


def telling(data: Dataset) -> np.ndarray:
    """(W,) bool: the windows that tell something of the robot, all of them if none does."""
    fit = ~unfit(data)
    return fit if fit.any() else np.ones_like(fit)


def without(data: Dataset, some: np.ndarray) -> Dataset:
    """The windows less some (W,), or all of them if none would be left."""
    return data if some.all() else data.take(~some)


def across(data: Dataset, stretches: Sequence[KeptBack]) -> np.ndarray:
    """(W,) bool: the windows that share more than a moment with any of the stretches."""
    out = np.zeros(data.count, dtype=bool)
    for i in np.unique(data.run):
        mine, name = data.run == i, data.runs[int(i)].name
        spans = [(k.start, k.end) for k in stretches if k.run == name and k.start is not None and k.end is not None]
        out[mine] = ~clear_of(spans, data.start[mine], data.horizon)
    return out


def without_unfit(data: Dataset, kept: Sequence[KeptBack]) -> tuple[KeptBack, ...]:
    """What is held out, without the windows that no fit may see: a run or block that contains such windows is split
    into the blocks between them. All of it if nothing else would be left."""
    lost, names = unfit(data), [run.name for run in data.runs]
    out: list[KeptBack] = []
    for k in kept:
        mine = data.run == names.index(k.run) if k.run in names else np.zeros(data.count, dtype=bool)
        if k.start is not None and k.end is not None:
            mine &= (data.start >= k.start - SLACK) & (data.start + data.horizon <= k.end + SLACK)
        out += [k] if not (mine & lost).any() else blocks_of(k.run, data.start[mine & ~lost], data.horizon)
    return tuple(out) or tuple(kept)


def _left_out(data: Dataset, spans: Sequence[Spans]) -> np.ndarray:
    clear = np.ones(data.count, dtype=bool)
    for i in np.unique(data.run):
        mine = data.run == i
        clear[mine] = clear_of(spans[int(i)], data.start[mine], data.horizon)
    for (i, channel), signal in data.signals.items():
        mine = data.run == i
        if channel.split(".")[0] in POSITION_LIKE and len(signal.t) > 1 and mine.any():
            clear[mine] &= _distance(signal.t, data.start[mine]) <= FAR * float(np.median(np.diff(signal.t)))
    return ~clear


def _distance(t: np.ndarray, at: np.ndarray) -> np.ndarray:
    """(W,) s: from each instant (W,) to the nearest stamp of t (n,)."""
    right = np.clip(np.searchsorted(t, at), 1, len(t) - 1)
    return np.asarray(np.minimum(np.abs(t[right - 1] - at), np.abs(t[right] - at)))


def blocks_of(run: str, starts: np.ndarray, horizon: float, apart: int = 0) -> list[KeptBack]:
    """Blocks of neighbouring windows that begin at starts (W,) s; up to `apart` others may lie between two of one."""
    starts = np.sort(starts)
    parts = np.split(starts, np.flatnonzero(np.diff(starts) > (apart + 1.5) * horizon) + 1) if len(starts) else []
    return [KeptBack(run, float(p[0]), float(p[-1] + horizon)) for p in parts]
