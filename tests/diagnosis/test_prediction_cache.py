"""What was replayed once is not replayed again: on the same windows, on some of them, and cut short."""

from collections.abc import Sequence

import numpy as np
import pytest
from oracles.rover_euler import TRACK_WIDTH, WHEEL_RADIUS
from oracles.rover_log import SIGMA, rover_run

from plants.diff_drive import DiffDrive
from residual_mpc.diagnosis.data.dataset import Dataset, build_dataset
from residual_mpc.diagnosis.data.subsampling import shorten
from residual_mpc.diagnosis.predict import prediction_cache as module
from residual_mpc.diagnosis.predict.candidates import build_space
from residual_mpc.diagnosis.predict.prediction_cache import PredictionCache
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.diagnosis.predict.space import Space
from residual_mpc.models.settings import Knob, Settings, Values

ROVER = DiffDrive("rover", WHEEL_RADIUS, TRACK_WIDTH)
DELAY, LATE = Knob("command_delay", None, "delay"), Knob("sensor_delay", None, "delay")
HYPOTHESES: list[Values] = [{DELAY: 0.03}, {LATE: 0.05}, {DELAY: 0.02, LATE: 0.01}]


@pytest.fixture(scope="module")
def data() -> Dataset:
    runs = [rover_run(f"run{seed}", {"command_delay": {"delay": 0.06}}, 8.0, seed=seed) for seed in range(2)]
    return build_dataset(runs, [ROVER] * 2, SIGMA)


@pytest.fixture(scope="module")
def space(data: Dataset) -> Space:
    return build_space(data, ())


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many hypotheses each replay was asked for."""
    rows: list[int] = []

    def counted(data: Dataset, settings: Settings) -> np.ndarray:
        rows.append(settings.rows)
        return predict(data, settings)

    monkeypatch.setattr(module, "predict", counted)
    return rows


def test_only_new_hypotheses_are_replayed(data: Dataset, space: Space, asked: list[int]) -> None:
    replays = PredictionCache(data, space)
    first = replays(HYPOTHESES[:2])
    again = replays([HYPOTHESES[1], HYPOTHESES[2], HYPOTHESES[0]])
    assert asked == [2, 1]
    np.testing.assert_array_equal(again, predict(data, space.settings([HYPOTHESES[k] for k in (1, 2, 0)])))
    np.testing.assert_array_equal(first, again[[2, 0]])


def test_numbers_that_differ_in_their_last_digits_are_the_same(data: Dataset, space: Space, asked: list[int]) -> None:
    replays = PredictionCache(data, space)
    replays([{DELAY: 0.03}])
    replays([{DELAY: 0.03 * (1.0 + 3e-16)}])
    replays([{DELAY: 0.03 * (1.0 + 1e-9)}])
    assert asked == [1, 1]


@pytest.mark.parametrize("part", [1.0, 0.5])
def test_some_windows_know_what_all_of_them_know(data: Dataset, space: Space, asked: list[int], part: float) -> None:
    pick = np.arange(data.count) % 3 == 1
    few = shorten(data, part).take(pick)
    whole = PredictionCache(data, space)
    whole(HYPOTHESES[:2])
    found = whole.of(few, pick)(HYPOTHESES)
    assert asked == [2, 1]
    expected = predict(few, space.settings(HYPOTHESES))
    there = np.isfinite(few.y)
    np.testing.assert_allclose(found[:, there], expected[:, there], atol=1e-12)


def test_the_oldest_are_forgotten(data: Dataset, space: Space, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "ROOM", 2 * data.y.size)
    replays = PredictionCache(data, space)
    many: Sequence[Values] = [{DELAY: 0.01 * k} for k in range(1, 6)]
    found = replays(many)
    assert len(replays.kept) == 2
    np.testing.assert_array_equal(replays(many), found)
