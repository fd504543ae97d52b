"""The motions of one window at equal instants: what was measured, what the model predicts, and the corrected model."""

from dataclasses import dataclass, replace

import numpy as np

from residual_mpc.diagnosis.data.dataset import Block, Dataset
from residual_mpc.diagnosis.predict.group_space import Sizes
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.diagnosis.results.records import DiagnosisResult
from residual_mpc.models.drawing import Motion
from residual_mpc.models.settings import Values
from residual_mpc.report.evidence.in_groups import settings_in_groups

FRAMES = 25


@dataclass(frozen=True)
class Ghosts:
    """The position channels of the robot's states, each (F,), as the sensors report them. assumed: channels without a
    sample in the window, which `measured` has from `predicted`; corrected: None where no effect is named; seconds: from
    the first frame to the last."""

    measured: Motion
    predicted: Motion
    corrected: Motion | None
    assumed: tuple[str, ...]
    seconds: float

    @property
    def motions(self) -> tuple[Motion, ...]:
        """In the order in which they are drawn."""
        return (self.measured, self.predicted, *(() if self.corrected is None else (self.corrected,)))


def measured_channels(data: Dataset, window: int) -> tuple[str, ...]:
    """The position channels of the robot's states that have at least two samples in the window."""
    wanted = {s.position for s in block_of(data, window).robot.states}
    count = np.isfinite(data.y[window]).sum(axis=0)
    return tuple(c for c, n in zip(data.channels, count.tolist(), strict=True) if c in wanted and n > 1)


def ghosts(made: DiagnosisResult, window: int, frames: int = FRAMES) -> Ghosts:
    """The motions of a window of `made.data`, at so many instants."""
    data = made.data
    wanted = tuple(s.position for s in block_of(data, window).robot.states)
    seen = measured_channels(data, window)
    t = data.t[window]
    instants = np.linspace(0.0, float(np.nanmax(t)), frames)

    def measured(channel: str) -> np.ndarray:
        return _at(instants, t, data.y[window, :, data.channels.index(channel)])

    def known(error: np.ndarray) -> dict[str, np.ndarray]:
        """What a model says of the channels that were measured: measurement less error (M, C)."""
        columns = {c: data.channels.index(c) for c in seen}
        return {c: _at(instants, t, data.y[window, :, k] - error[:, k]) for c, k in columns.items()}

    others = tuple(c for c in wanted if c not in seen)
    predicted = {**known(made.before[window]), **_replayed(data, window, made.base, others, instants)}
    corrected = None
    if made.diagnosis.causes:
        corrected = {
            **known(made.after[window]),
            **_replayed(data, window, made.diagnosis.values, others, instants, made.diagnosis.groups_of_windows),
        }
    motion = {c: measured(c) if c in seen else predicted[c] for c in wanted}
    return Ghosts(motion, predicted, corrected, others, float(instants[-1]))


def block_of(data: Dataset, window: int) -> Block:
    """The block that a window belongs to."""
    return next(b for b in data.blocks if b.where.start <= window < b.where.stop)


def _replayed(
    data: Dataset,
    window: int,
    values: Values,
    channels: tuple[str, ...],
    instants: np.ndarray,
    groups: tuple[Sizes, ...] = (),
) -> dict[str, np.ndarray]:
    """Channels without samples in the window, replayed under these values: channel -> (F,). groups: the sizes of
    effects in groups of windows."""
    if not channels:
        return {}
    one = data.take(np.arange(data.count) == window)
    new = tuple(c for c in channels if c not in one.channels)
    one = replace(one, channels=(*one.channels, *new))
    robot = one.blocks[0].robot
    found = predict(one, settings_in_groups(robot, [values], groups))[0, 0]
    return {c: _at(instants, one.t[0], found[:, one.channels.index(c)]) for c in channels}


def _at(instants: np.ndarray, t: np.ndarray, y: np.ndarray) -> np.ndarray:
    """(F,) the samples y (M,) at times t (M,), joined by straight lines."""
    good = np.isfinite(t) & np.isfinite(y)
    return np.interp(instants, t[good], y[good])
