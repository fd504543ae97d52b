"""Every run's signals, measured and predicted, for the page's script to draw: few enough samples for one file."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from residual_mpc.diagnosis.results.records import DiagnosisResult
from residual_mpc.report.evidence.evidence import Array

VALUES = 240_000  # of all runs together, about 0.7 MB on the page
DENSEST, SPARSEST = 60, 12  # samples of a window
CHANNELS = 6


@dataclass(frozen=True)
class Signals:
    """One channel of a run, each (n,) in the channel's unit. after: NaN throughout where no effect is named."""

    channel: str
    measured: Array
    before: Array
    after: Array


@dataclass(frozen=True)
class RunTraces:
    """One run. t (n,): s since its first stamp; first (w,): index of each window's first sample; before, after (w,):
    the windows' gaps; held_out (w,): whether no fit has seen the window."""

    run: str
    t: Array
    first: NDArray[np.int_]
    before: Array
    after: Array
    held_out: NDArray[np.bool_]
    signals: tuple[Signals, ...]


def run_traces(made: DiagnosisResult, before: Array, after: Array) -> tuple[RunTraces, ...]:
    """The run with the largest gap first. before, after: (W,) gaps of the windows of `made.data`.

    Where all windows together would be too large, those that were held out and those with the largest gaps are kept.
    """
    shares = dict(made.diagnosis.where.channels)
    ranked = sorted((c for c in made.data.channels if c in shares), key=lambda c: -shares[c])[:CHANNELS]
    usable = np.flatnonzero(np.isfinite(before))
    if not ranked or not len(usable):
        return ()
    each = 3 * len(ranked)
    most = max(VALUES // (SPARSEST * each), 1)
    chosen = usable[np.lexsort((-before[usable], ~made.held[usable]))][:most]
    samples = int(np.clip(VALUES // (len(chosen) * each), SPARSEST, DENSEST))
    out = []
    for run in np.unique(made.data.run[chosen]):
        mine = chosen[made.data.run[chosen] == run]
        out.append(_traces(made, mine[np.argsort(made.data.start[mine])], ranked, samples, before, after))
    return tuple(sorted(out, key=lambda traces: -float(np.sqrt(np.mean(traces.before**2)))))


def _traces(
    made: DiagnosisResult, windows: NDArray[np.int_], channels: list[str], samples: int, before: Array, after: Array
) -> RunTraces:
    data = made.data
    columns = [data.channels.index(c) for c in channels]
    run = data.runs[data.run[windows[0]]]
    rows = [_rows(data.t[w], data.y[w][:, columns], samples) for w in windows]
    t = np.concatenate([data.start[w] + data.t[w, r] for w, r in zip(windows, rows, strict=True)]) - float(run.t[0])

    def joined(errors: Array | None, k: int) -> Array:
        """Measurement less the errors (W, M, C) of a model; the measurement itself where there are none."""
        pairs = zip(windows, rows, strict=True)
        return np.concatenate([data.y[w, r, k] - (0.0 if errors is None else errors[w, r, k]) for w, r in pairs])

    explained = bool(made.diagnosis.causes)
    none = np.full(len(t), np.nan)
    signals = tuple(
        Signals(c, joined(None, k), joined(made.before, k), joined(made.after, k) if explained else none)
        for c, k in zip(channels, columns, strict=True)
    )
    first = np.concatenate([[0], np.cumsum([len(r) for r in rows])[:-1]])
    gaps = before[windows], after[windows] if explained else np.full(len(windows), np.nan)
    return RunTraces(run.name, t, first, *gaps, made.held[windows], signals)


def _rows(t: Array, y: Array, samples: int) -> NDArray[np.int_]:
    """At most so many samples of a window, (M,) and (M, C), at which something was measured."""
    there = np.flatnonzero(np.isfinite(t) & np.isfinite(y).any(axis=1))
    return there[np.unique(np.linspace(0, len(there) - 1, min(samples, len(there))).astype(int))]
