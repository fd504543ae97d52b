"""One run with its predictions: the signals that a recording holds."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from residual_mpc.diagnosis.data.dataset import Block, Dataset
from residual_mpc.diagnosis.data.gap import Scales, gap_of, per_window
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.logs.columns import PER_ACTUATOR, group
from residual_mpc.logs.run import Run
from residual_mpc.logs.signals import continuous
from residual_mpc.models.protocol import Robot
from residual_mpc.models.settings import Settings

Array = np.ndarray
Columns = Mapping[str, Array]


@dataclass(frozen=True, eq=False)
class Replay:
    """What one model predicts in every window of a dataset.

    data: as the model sees them; predicted (W, M, C), channel units, NaN where padded; gaps (W,) unitless, NaN where a
    window has nothing to compare. Of the C `channels` those of the data come first, then positions of the robot's
    states that nobody measured.
    """

    data: Dataset
    channels: tuple[str, ...]
    predicted: Array
    gaps: Array

    def gap_over(self, scales: Scales, windows: Array) -> float:
        """The gap over the windows of a mask (W,)."""
        return gap_of(self.data, scales, self._error, windows).total

    @property
    def _error(self) -> Array:
        return np.asarray(self.data.y - self.predicted[..., : len(self.data.channels)])


@dataclass(frozen=True, eq=False)
class Windows:
    """The windows of a run in order. start, end (w,) s from the run's start; nominal, corrected (w,): each window's own
    gap, NaN where it has nothing to compare."""

    start: Array
    end: Array
    nominal: Array
    corrected: Array


@dataclass(frozen=True, eq=False)
class Trace:
    """A run and what two models predict of it.

    Attributes:
        run: its name.
        start: s, what the log's own clock showed at t = 0.
        t: (n,) s from the run's start.
        measured: column -> (n,), angles without their jumps of 2 pi; NaN is a missing sample.
        sent: command and enabled columns -> (n,), as they were logged.
        windows: w consecutive windows of the horizon.
        window: (k,) which window a predicted sample belongs to, increasing; a stamp on a border belongs to both.
        at: (k,) s from the run's start.
        nominal, corrected: channel -> (k,), as the sensors would report it.
        channels: those of the predicted channels that were measured in the run.
        robot: the model with which the run was replayed.
    """

    run: str
    start: float
    t: Array
    measured: Columns
    sent: Columns
    windows: Windows
    window: Array
    at: Array
    nominal: Columns
    corrected: Columns
    channels: tuple[str, ...]
    robot: Robot

    @property
    def seconds(self) -> float:
        """s from the first stamp to the last."""
        return float(self.t[-1] - self.t[0])


def replay(data: Dataset, settings: Settings, scales: Scales) -> Replay:
    """Replay every window under one hypothesis (settings with one row)."""
    positions = [s.position for b in data.blocks for s in b.robot.states]
    channels = tuple(dict.fromkeys((*data.channels, *positions)))
    predicted = predict(replace(data, channels=channels), settings)[0]
    gaps = np.sqrt(per_window(data, scales, data.y - predicted[..., : len(data.channels)]))
    return Replay(data, channels, predicted, gaps)


def traces(runs: Sequence[Run], robots: Sequence[Robot], nominal: Replay, corrected: Replay) -> tuple[Trace, ...]:
    """One trace a run, robots[i] being the model of runs[i]. A run of which no window has a measured start has no
    predictions."""
    return tuple(_trace(i, run, robots[i], nominal, corrected) for i, run in enumerate(runs))


def _trace(i: int, run: Run, robot: Robot, nominal: Replay, corrected: Replay) -> Trace:
    data, begin = nominal.data, float(run.t[0])
    mine = np.flatnonzero(data.run == i)
    mine = mine[np.argsort(data.start[mine], kind="stable")]
    there = np.isfinite(data.t[mine])
    window, _ = np.nonzero(there)
    at = (data.t[mine] + data.start[mine, None])[there] - begin
    first = data.start[mine] - begin
    windows = Windows(first, first + data.horizon, nominal.gaps[mine], corrected.gaps[mine])
    if len(mine):
        robot = _block(data, int(mine[0])).robot

    def predicted(by: Replay) -> Columns:
        rows = by.predicted[mine]
        known = {c: rows[..., k][there] for k, c in enumerate(by.channels)}
        return {c: y for c, y in known.items() if np.isfinite(y).any()}

    by_nominal, by_corrected = predicted(nominal), predicted(corrected)
    channels = tuple(c for c in data.channels if c in run.measured and c in by_nominal)
    measured = {c: continuous(c, run.columns[c]) for c in run.measured}
    sent = {c: y for c, y in run.columns.items() if group(c) in PER_ACTUATOR}
    return Trace(
        run.name, run.start + begin, run.t - begin, measured, sent, windows, window, at, by_nominal, by_corrected,
        channels, robot,
    )  # fmt: skip


def _block(data: Dataset, window: int) -> Block:
    return next(b for b in data.blocks if b.where.start <= window < b.where.stop)
