"""Windows that begin in a pause of the sensor, or at a spike: the noise floor counts them, and one alone is no gap."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from oracles.rover_log import SIGMA, rover_run

from plants.diff_drive import DiffDrive
from residual_mpc.diagnosis.data.dataset import Dataset, build_dataset
from residual_mpc.diagnosis.data.gap import gap_of, measure_scales, with_sound_starts
from residual_mpc.diagnosis.predict.noise_floor import floor_of, poorly_begun
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.diagnosis.predict.settings import PredictSettings
from residual_mpc.logs.run import Run
from residual_mpc.models.settings import Settings

ROVER = DiffDrive("rover", 0.033, 0.16)
SETTINGS = PredictSettings()
QUIET = {c: 0.2 * s for c, s in SIGMA.items()}  # so that a poor start shows
FEW = replace(SETTINGS, floor=replace(SETTINGS.floor, steps=600))  # of 24 windows of 100 steps, six


def paused(run: Run, begin: float, end: float) -> Run:
    """The run without a pose between two times."""
    inside = (run.t > begin) & (run.t < end)
    return replace(run, columns={c: np.where(inside, np.nan, y) if c in SIGMA else y for c, y in run.columns.items()})


def data_of(pauses: dict[int, tuple[float, float]]) -> Dataset:
    """Runs of 40 s, in windows of 5 s."""
    runs = [rover_run(f"r{k}", {}, 40.0, seed=k, noise=0.2) for k in range(3)]
    return build_dataset(
        [paused(r, *pauses[k]) if k in pauses else r for k, r in enumerate(runs)], [ROVER] * 3, QUIET, 5.0
    )


@pytest.mark.slow
def test_a_window_that_begins_in_a_pause_is_poorly_begun() -> None:
    data = data_of({1: (14.78, 15.18)})
    poor = poorly_begun(data, SETTINGS)
    assert list(zip(data.run[poor].tolist(), data.start[poor].tolist(), strict=True)) == [(1, 15.0)]
    assert not poorly_begun(data_of({}), SETTINGS).any()


def test_a_log_that_is_like_that_everywhere_has_none() -> None:
    runs = [rover_run(f"r{k}", {}, 40.0, seed=k, noise=0.2) for k in range(3)]
    for start in range(5, 40, 5):
        runs = [paused(r, start - 0.22, start + 0.18) for r in runs]
    data = build_dataset(runs, [ROVER] * 3, QUIET, 5.0)
    assert not poorly_begun(data, SETTINGS).any()


@pytest.mark.slow
def test_the_floor_of_few_windows_counts_those_with_a_poor_start() -> None:
    """As the floor of all windows has it, and not only if they happen to be drawn."""
    data = data_of({1: (14.78, 15.18)})
    scales = measure_scales(data)
    every = floor_of(data, scales, Settings(1), np.random.default_rng(0), SETTINGS).total
    few = floor_of(data, scales, Settings(1), np.random.default_rng(0), FEW).total
    smooth = floor_of(data_of({}), scales, Settings(1), np.random.default_rng(0), SETTINGS).total
    assert every > 1.3 * smooth
    assert few == pytest.approx(every, rel=0.2)


def test_a_window_that_misses_from_its_start_makes_no_gap_alone() -> None:
    data = data_of({1: (14.78, 15.18)})
    scales, error = measure_scales(data), data.y - predict(data, Settings(1))[0]
    spoilt = (data.run == 1) & (data.start == 15.0)
    error[spoilt] += 0.2  # m, rad
    assert with_sound_starts(data, scales, error, 4).total == pytest.approx(gap_of(data, scales, error, ~spoilt).total)
    every = gap_of(data, scales, error).total
    assert with_sound_starts(data, scales, error, data.count + 1).total == pytest.approx(every)


def test_one_that_begins_well_counts() -> None:
    """An impact, or a wheel that slips once."""
    data = data_of({})
    scales, error = measure_scales(data), data.y - predict(data, Settings(1))[0]
    error[3] += 0.2 * (data.t[3] > 2.0)[:, None]
    assert with_sound_starts(data, scales, error, 4).total == pytest.approx(gap_of(data, scales, error).total)
