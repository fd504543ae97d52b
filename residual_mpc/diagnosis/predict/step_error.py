"""How much of a model's prediction is the error of its own time step, seen by halving it."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.gap import Scales, gap_of, window_trust
from residual_mpc.diagnosis.data.settings import DataSettings
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.models import optional
from residual_mpc.models.settings import Settings

WINDOWS = 40  # of a figure that is reported
MADE_WINDOWS = 24  # on which a search asks whether the step makes what is left


def finer_prediction(data: Dataset, row: Settings, here: np.ndarray | None = None) -> np.ndarray | None:
    """(W, M, C) what has to be added to the prediction of a model (settings of one row) to get that of one stepped
    infinitely finely, by Richardson's extrapolation of a step and its half at order 1 (Hairer, Norsett and Wanner,
    Solving ODEs I, 1993, section II.4). here: the prediction with the whole step. None where no model has another step.
    """
    halves = with_half_steps(data)
    if halves is None:
        return None
    whole = predict(data, row)[0] if here is None else here
    return np.asarray(2.0 * (predict(halves, row)[0] - whole))


def finest_prediction(data: Dataset, row: Settings, here: np.ndarray) -> np.ndarray | None:
    """The same from a step, its half and its quarter, at order 2; where nothing was measured it may be NaN."""
    halves = with_half_steps(data)
    quarters = None if halves is None else with_half_steps(halves)
    if halves is None or quarters is None:
        return None
    half, quarter = (predict(d, row)[0] for d in (halves, quarters))
    return np.asarray((8.0 * quarter - 6.0 * half + here) / 3.0 - here)


def with_half_steps(data: Dataset) -> Dataset | None:
    """The windows with models of half the time step; None where no model has another step."""
    finer = [optional.with_half_step(block.robot) for block in data.blocks]
    halves = tuple(replace(b, robot=r) for b, r in zip(data.blocks, finer, strict=True) if r is not None)
    return replace(data, blocks=halves) if halves and len(halves) == len(data.blocks) else None


def step_error(
    data: Dataset, scales: Scales, row: Settings, settings: DataSettings, windows: int = WINDOWS
) -> float | None:
    """The gap between a model and one stepped infinitely finely, on at most so many windows; those that diverge count
    little. None where no model here has another step."""
    few = some_windows(data, windows)
    apart = finer_prediction(few, row)
    if apart is None:
        return None
    return float(gap_of(few, scales, apart, window_trust(few, scales, apart, settings=settings)).total)


def made_by_step(data: Dataset, scales: Scales, row: Settings, floor: float, settings: DataSettings) -> bool:
    """Whether the error of the model's own time step accounts for what the model (settings of one row) misses: it is as
    large as that, and taking as much of it out as fits best leaves less than half. What is left has to look like the
    error of the step: a wrong wheel radius may be as large and look otherwise.

    floor: squared gap of a perfect model."""
    few = some_windows(data, MADE_WINDOWS)
    here = predict(few, row)[0]
    apart = finer_prediction(few, row, here)
    if apart is None:
        return False
    trust = window_trust(few, scales, apart, settings=settings)
    error = few.y - here
    left, step = (float(gap_of(few, scales, e, trust).total) ** 2 for e in (error, apart))
    if left - floor > step:
        return False
    rest = error - step_share(few, scales, error, apart, settings) * apart
    return float(gap_of(few, scales, rest, trust).total) ** 2 - floor < 0.5 * (left - floor)


def step_share(data: Dataset, scales: Scales, error: np.ndarray, apart: np.ndarray, settings: DataSettings) -> float:
    """How much of the step's error apart (W, M, C) is in a model's errors (W, M, C): 1 if what made the runs has no
    step. Windows that diverge count little."""
    trust = window_trust(data, scales, error, settings=settings)[:, None, None]
    both = np.isfinite(error) & np.isfinite(apart) & scales.compared
    wrong, step = (np.where(both, x / scales.motion, 0.0) for x in (error, apart))
    return float(np.clip(np.sum(trust * wrong * step) / max(np.sum(trust * step * step), 1e-300), 0.0, 1.0))


def some_windows(data: Dataset, windows: int) -> Dataset:
    """At most so many windows, evenly."""
    return data.take(
        np.isin(np.arange(data.count), np.linspace(0, data.count - 1, min(data.count, windows)).astype(int))
    )


def within_step_error(data: Dataset, scales: Scales, rows: Settings, settings: DataSettings) -> np.ndarray:
    """(H,) bool: which predictions differ from that of the first row of settings by less than the error of the model's
    own time step. A delay before the actuator and one behind the sensor, for example, are rounded to steps in different
    ways."""
    error = step_error(data, scales, rows.take(np.array([0])), settings)
    if error is None:
        return np.arange(rows.rows) == 0
    first, *others = predict(data, rows)
    return np.array([True, *no_farther_than(data, scales, first, others, error)])


def no_farther_than(
    data: Dataset, scales: Scales, own: np.ndarray, others: Sequence[np.ndarray], gap: float
) -> list[bool]:
    """Which predictions (W, M, C) differ from `own` by no more than a gap, where something was measured."""
    seen = np.isfinite(data.y)
    return [bool(gap_of(data, scales, np.where(seen, other - own, np.nan)).total <= gap) for other in others]
