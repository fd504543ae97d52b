"""A long log costs no more than it tells: what is looked at less closely, and that the answer stays."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from oracles.rover_euler import TRACK_WIDTH, WHEEL_RADIUS
from oracles.rover_log import SIGMA, rover_run

from plants.diff_drive import DiffDrive
from residual_mpc.diagnosis.data.dataset import Dataset, build_dataset
from residual_mpc.diagnosis.data.settings import DataSettings
from residual_mpc.diagnosis.data.subsampling import evenly
from residual_mpc.diagnosis.diagnose import diagnose
from residual_mpc.diagnosis.options import Options
from residual_mpc.diagnosis.phases.search import _budget
from residual_mpc.diagnosis.predict.noise_floor import floor_draws
from residual_mpc.diagnosis.predict.settings import PredictSettings
from residual_mpc.diagnosis.results.records import Diagnosis

ROVER = DiffDrive("rover", WHEEL_RADIUS, TRACK_WIDTH)
HIDDEN = {"track_width": {"scale": 1.1}, "command_delay": {"delay": 0.06}}
RUNS = [rover_run(f"run{seed}", HIDDEN, 16.0, seed=seed) for seed in range(4)]


@pytest.fixture(scope="module")
def data() -> Dataset:
    return build_dataset(RUNS, [ROVER] * 4, SIGMA)


def test_windows_are_taken_evenly_and_never_too_few(data: Dataset) -> None:
    steps = data.count * data.blocks[0].drive.steps
    assert evenly(data, steps, settings=DataSettings()).all()
    some = evenly(data, int(0.7 * steps), settings=DataSettings())
    assert some.sum() == pytest.approx(0.7 * data.count, abs=1) and np.diff(np.flatnonzero(some)).max() <= 2
    assert evenly(data, 1, settings=DataSettings()).sum() == DataSettings().subsampling.fewest


def test_the_floor_is_drawn_less_often_from_more_windows(data: Dataset) -> None:
    steps, floor = data.count * data.blocks[0].drive.steps, PredictSettings().floor
    assert [floor_draws(data, n, settings=PredictSettings()) for n in (steps, steps // 2, 1)] == [
        floor.most_draws,
        floor.most_draws // 2,
        floor.fewest_draws,
    ]


@pytest.fixture(scope="module")
def whole_and_thinned() -> tuple[Diagnosis, ...]:
    """Of the windows that may be fitted, the last fit and the shares take all, and then two thirds."""
    chosen = tuple(HIDDEN)
    return tuple(
        diagnose(RUNS, [ROVER] * 4, SIGMA, (), Options(only=chosen, final_steps=n), np.random.default_rng(0)).diagnosis
        for n in (100_000, 3_500)
    )


def test_thinning_does_not_change_the_answer(whole_and_thinned: tuple[Diagnosis, ...]) -> None:
    whole, thinned = whole_and_thinned
    assert [str(c.term) for c in whole.causes] == [str(c.term) for c in thinned.causes]
    assert {c.term.effect for c in whole.causes} == set(HIDDEN)
    for a, b in zip(whole.causes, thinned.causes, strict=True):
        for was, now in zip(a.parameters, b.parameters, strict=True):
            assert now.value == pytest.approx(was.value, abs=0.1 * (was.ci95[1] - was.ci95[0]))
    assert thinned.gap.after == pytest.approx(whole.gap.after, rel=0.01)


def test_the_chain_is_over_all_windows_and_the_shares_are_whole(whole_and_thinned: tuple[Diagnosis, ...]) -> None:
    whole, thinned = whole_and_thinned
    assert [s.effects for s in thinned.steps] == [s.effects for s in whole.steps]
    np.testing.assert_allclose([s.gap for s in thinned.steps], [s.gap for s in whole.steps], rtol=0.02)
    assert sum(s.share for s in thinned.stages) == pytest.approx(1.0)
    was = {s.name: s.share for s in whole.stages}
    assert {s.name: s.share for s in thinned.stages} == pytest.approx(was, abs=0.05)


@dataclass(frozen=True)
class OfJoints:
    """What a search asks of a robot: its measured joints, and all of them where a chain is closed."""

    states: tuple[int, ...]
    joints: tuple[str, ...]
    actuators: tuple[str, ...] = ()


@pytest.mark.parametrize(
    ("measured", "joints", "steps"), [(1, 1, 5000), (3, 3, 4000), (3, 5, 1440), (6, 6, 1000), (7, 12, 1000)]
)
def test_a_small_robot_is_searched_on_more_windows(measured: int, joints: int, steps: int) -> None:
    """Passive joints of a closed chain cost steps as well."""
    robot: Any = OfJoints((0,) * measured, ("j",) * joints)
    assert _budget(robot, 1000) == steps
