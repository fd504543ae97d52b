"""What the model misses in each window, and how the window was driven."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset, build_dataset
from residual_mpc.diagnosis.data.gap import Scales
from residual_mpc.diagnosis.data.outliers import find_outliers, with_outliers_removed
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.errors import BadInput
from residual_mpc.logs.run import Run
from residual_mpc.monitoring.model import WatchedModel

STILL = 0.01  # of the usual motion, below which less motion makes no difference
LEAD = 2.5  # s of a run before a window that its start and the memory of effects may need


@dataclass(frozen=True, eq=False)
class Windows:
    """W windows of one or more runs; C channels.

    run (W,) index of the run; start (W,) s since the run's first stamp; square (W, C): mean square of the error,
    channel units, NaN where nothing is compared; count (W, C) samples; moved (W, C): logarithm of the predicted motion,
    relative; driving (W, F): how the window was driven, in numbers that a change of the robot touches little.
    """

    run: np.ndarray
    start: np.ndarray
    square: np.ndarray
    count: np.ndarray
    moved: np.ndarray
    driving: np.ndarray

    def __len__(self) -> int:
        return len(self.start)

    def take(self, rows: np.ndarray) -> Windows:
        return replace(self, **{f.name: getattr(self, f.name)[rows] for f in fields(self)})


def dataset_of(
    runs: Sequence[Run],
    model: WatchedModel,
    noise: Mapping[str, float],
    horizon: float,
    starts: Sequence[np.ndarray] | None = None,
) -> Dataset:
    """Raises BadInput where no window has a measured start."""
    data = build_dataset(runs, [model.robot_of(r.name) for r in runs], noise, horizon, starts)
    return with_outliers_removed(data, find_outliers(data).flagged) if model.leaves_out else data


def windows_of(data: Dataset, model: WatchedModel, channels: Sequence[str], scales: Scales) -> Windows:
    """The windows of a dataset, in the order of their runs and starts; channels and scales are those of the
    reference."""
    predicted = predict(data, model.settings(data.blocks[0].robot))[0]
    error = np.where(data.compared[:, None, :], data.y - predicted, np.nan)
    place = [data.channels.index(c) if c in data.channels else -1 for c in channels]
    error, predicted = _placed(error, place), _placed(predicted, place)
    count = np.isfinite(error).sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        square = np.where(count > 0, np.nansum(error**2, axis=1) / count, np.nan)
    moved = np.log(_moved(predicted, scales) + STILL)
    found = Windows(data.run, data.start, square, count, moved, _driving(data, predicted, channels, scales))
    return found.take(np.lexsort((data.start, data.run)))


def new_windows(
    run: Run, starts: np.ndarray, model: WatchedModel, noise: Mapping[str, float], horizon: float,
    channels: Sequence[str], scales: Scales,
) -> Windows | None:  # fmt: skip
    """Some windows of one run; None where none of them can be predicted."""
    try:
        return windows_of(dataset_of([run], model, noise, horizon, [starts]), model, channels, scales)
    except BadInput:  # no window has a measured start
        return None


def _placed(values: np.ndarray, place: Sequence[int]) -> np.ndarray:
    """(W, M, channels of the data) -> (W, M, C), NaN where the data lack a channel."""
    padded = np.concatenate([values, np.full((*values.shape[:2], 1), np.nan)], axis=2)
    return padded[:, :, list(place)]


def _moved(predicted: np.ndarray, scales: Scales) -> np.ndarray:
    """(W, C) root mean square of the predicted motion since the window's start, relative."""
    there = np.maximum(np.isfinite(predicted).sum(axis=1), 1)
    return np.asarray(np.sqrt(np.nansum((predicted - predicted[:, :1]) ** 2, axis=1) / there) / scales.s)


def _driving(data: Dataset, predicted: np.ndarray, channels: Sequence[str], scales: Scales) -> np.ndarray:
    """(W, F): the predicted motion of each channel, where it starts unless that is a place on the ground, and the mean,
    mean magnitude and spread of each command. Predictions, since what was measured shows the change itself."""
    at = np.nan_to_num(predicted[:, 0]) / scales.s
    postures = [k for k, c in enumerate(channels) if not c.startswith("pose.")]
    n = max(b.drive.command.shape[2] for b in data.blocks)
    commands = np.zeros((data.count, 3 * n))
    for b in data.blocks:
        u = b.drive.command[:, b.drive.lead :]
        of = np.concatenate([u.mean(axis=1), np.abs(u).mean(axis=1), u.std(axis=1)], axis=1)
        commands[b.where, : of.shape[1]] = of
    return np.column_stack([_moved(predicted, scales), at[:, postures], commands])
