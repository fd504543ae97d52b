"""A search with longer steps: exact at the hypothesis that it goes on from, near it elsewhere, and not at any price."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest
from oracles.arms import arm_xml, robot_of
from oracles.rover_euler import TRACK_WIDTH, WHEEL_RADIUS
from oracles.rover_log import SIGMA, rover_run

from plants.diff_drive import DiffDrive
from plants.mujoco_robot.robot import MujocoRobot
from residual_mpc.checkpoint import Checkpoint, Keeper
from residual_mpc.diagnosis.data.dataset import Dataset, build_dataset
from residual_mpc.diagnosis.data.gap import gap_of, measure_scales
from residual_mpc.diagnosis.predict import noise_errors
from residual_mpc.diagnosis.predict.candidates import build_space
from residual_mpc.diagnosis.predict.longer_steps import longer_steps_of, quickened
from residual_mpc.diagnosis.predict.noise_floor import floor_of
from residual_mpc.diagnosis.predict.prediction_cache import Carried, PredictionCache
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.diagnosis.predict.settings import LongerStepSettings, PredictSettings
from residual_mpc.diagnosis.predict.space import Space
from residual_mpc.diagnosis.predict.step_lengths import with_longer_steps
from residual_mpc.logs.run import Run
from residual_mpc.models.settings import Knob, Settings, Values

SERVOS = '<position name="j1" joint="j1" kp="40" kv="4"/><position name="j2" joint="j2" kp="20" kv="2"/>'
STEP = 0.001  # s
LENIENT = LongerStepSettings(error=0.1)
FRICTION, LOAD = Knob("viscous_friction", "j1", "coefficient"), Knob("payload", None, "mass")
PLAY = Knob("backlash", "j2", "gap")
HERE: Values = {FRICTION: 0.4}
NEAR: Values = {FRICTION: 0.4, LOAD: 0.1}


def moving(seed: int, seconds: float = 8.0) -> Run:
    """Set points of two servos, and positions that follow them in some way: what is predicted matters here."""
    t, rng = 0.02 * np.arange(round(seconds / 0.02)), np.random.default_rng(seed)
    u = np.repeat(0.6 * rng.standard_normal((len(t) // 25 + 1, 2)), 25, axis=0)[: len(t)]
    q = np.stack([np.convolve(x, np.full(10, 0.1))[: len(t)] for x in u.T], axis=1)
    q += 1e-4 * rng.standard_normal(q.shape)
    columns = {f"command.j{i + 1}": u[:, i] for i in range(2)}
    return Run(f"run{seed}", t, columns | {f"position.j{i + 1}": q[:, i] for i in range(2)})


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> MujocoRobot:
    text = arm_xml(SERVOS).replace('timestep="0.002"', f'timestep="{STEP}"')
    return robot_of(tmp_path_factory.mktemp("arm"), text)


@pytest.fixture(scope="module")
def data(robot: MujocoRobot) -> Dataset:
    return build_dataset([moving(seed) for seed in range(2)], [robot] * 2, {})


@pytest.fixture(scope="module")
def space(data: Dataset) -> Space:
    return build_space(data, ())


def longer(data: Dataset, times: int) -> Dataset:
    found = with_longer_steps(data, times)
    assert found is not None
    return found


def test_predictions_are_the_models_own_about_a_hypothesis(data: Dataset, space: Space) -> None:
    coarse = PredictionCache(longer(data, 4), space, own=data)
    exact = predict(data, space.settings([HERE, NEAR]))
    here, near = (np.nanmax(np.abs(p - e)) for p, e in zip(coarse([HERE, NEAR]), exact, strict=True))
    assert here > 1e-4 and near > 1e-4
    about = coarse.about(HERE, np.ones(2), LENIENT)([HERE, NEAR])
    np.testing.assert_allclose(about[0], exact[0], atol=1e-12)
    moved = np.nanmax(np.abs(exact[1] - exact[0]))
    assert np.nanmax(np.abs(about[1] - exact[1])) < 0.05 * moved


def test_parts_of_the_windows_keep_what_the_steps_change(data: Dataset, space: Space) -> None:
    coarse = longer(data, 4)
    about = PredictionCache(coarse, space, own=data).about(HERE, np.ones(2), LENIENT)
    pick = np.arange(data.count) % 3 == 0
    part = about.of(coarse.take(pick), pick)
    np.testing.assert_allclose(part([NEAR])[0], about([NEAR])[0][pick][:, : part.data.y.shape[1]], atol=1e-12)


def test_longer_steps_are_given_up_where_they_change_too_much(data: Dataset, space: Space) -> None:
    coarse = PredictionCache(longer(data, 4), space, own=data)
    given_up = coarse.about(HERE, np.ones(2), replace(LENIENT, error=1e-6))
    assert given_up.data is data and given_up.own is None
    np.testing.assert_array_equal(given_up([NEAR]), predict(data, space.settings([NEAR])))


def test_shorter_steps_are_taken_where_long_ones_change_too_much(data: Dataset, space: Space) -> None:
    def largest(times: int) -> float:
        change = predict(longer(data, times), space.settings([HERE])) - predict(data, space.settings([HERE]))
        return float(np.sqrt(np.nanmean(change[0] ** 2, axis=(0, 1))).max())

    coarse = PredictionCache(longer(data, 8), space, own=data)
    between = replace(LENIENT, error=0.5 * (largest(2) + largest(4)))
    about = coarse.about(HERE, np.ones(2), between)
    assert about.data.blocks[0].own == 2 and about.own is data
    exact = predict(data, space.settings([HERE, NEAR]))
    found = about([HERE, NEAR])
    np.testing.assert_allclose(found[0], exact[0], atol=1e-12)
    assert np.nanmax(np.abs(found[1] - exact[1])) < 0.05 * np.nanmax(np.abs(exact[1] - exact[0]))


def test_shorter_steps_remember_what_was_predicted_on_them(data: Dataset, space: Space) -> None:
    """Until others take their place."""
    coarse = PredictionCache(longer(data, 8), space, own=data)
    given_up, lenient = replace(LENIENT, error=1e-6), replace(LENIENT, error=0.9, of_left=0.9)
    first = coarse.about(HERE, np.ones(2), given_up)
    first([NEAR])
    first.carried.append(Carried({}, (), np.zeros((data.count, 1, 0))))
    again = coarse.about(NEAR, np.ones(2), given_up)
    assert again.carried == first.carried and again.kept is first.kept and again.own is None
    assert coarse.about(HERE, np.ones(2), lenient).own is data
    assert not coarse.about(HERE, np.ones(2), given_up).carried
    assert coarse.shorter and not coarse.__getstate__()["shorter"]  # a checkpoint is large enough without it


def test_longer_steps_are_given_up_where_they_change_as_much_as_is_left(data: Dataset, space: Space) -> None:
    """One channel that is explained is enough: its next cause is smaller than what the steps change."""
    exact = predict(data, space.settings([HERE]))[0]
    found = replace(data, y=np.where([True, False], exact + 1e-4, data.y))
    own = PredictionCache(longer(found, 4), space, own=found)
    assert own.about(HERE, np.ones(2), LENIENT).own is None
    nothing = PredictionCache(longer(data, 4), space, own=data)
    assert nothing.about(HERE, np.ones(2), LENIENT).own is data


def test_split_gears_keep_the_steps_of_the_model(data: Dataset, space: Space) -> None:
    """Between set points that last for many steps nothing but the steps differs, and a gear's are not longer."""
    rows = space.settings([{PLAY: 0.05}])
    own, coarse = predict(data, rows), predict(longer(data, 4), rows)
    aligned = np.nanmax(np.abs(own - coarse))
    without = np.nanmax(np.abs(predict(data, space.settings([{}])) - predict(longer(data, 4), space.settings([{}]))))
    assert aligned < 0.1 * without


def test_what_longer_steps_change_is_not_added_to_split_gears(data: Dataset, space: Space) -> None:
    """They are replayed with the model's own steps: only how commands are averaged differs."""
    about = PredictionCache(longer(data, 4), space, own=data).about(HERE, np.ones(2), LENIENT)
    assert about.own is not None
    split: Values = {**HERE, PLAY: 0.05}
    exact = predict(data, space.settings([split]))[0]
    apart = np.nanmax(np.abs(about([split])[0] - exact))
    assert apart < 0.2 * np.nanmax(np.abs(about.change))
    none: Values = {**HERE, PLAY: 0.0}
    np.testing.assert_allclose(about([none])[0], about([HERE])[0], atol=1e-12)


def test_longer_steps_are_given_up_about_split_gears(data: Dataset, space: Space) -> None:
    coarse = PredictionCache(longer(data, 4), space, own=data)
    assert coarse.about({PLAY: 0.05}, np.ones(2), LENIENT).own is None


def test_the_longest_steps_that_change_little_are_chosen(data: Dataset) -> None:
    scales = measure_scales(data)

    def chosen(error: float) -> int:
        settings = PredictSettings(longer_steps=LongerStepSettings(error=error))
        return quickened(data, scales, settings=settings).blocks[0].own

    assert chosen(0.9) == 10 and chosen(1e-9) == 1
    nominal = predict(data, Settings(1))[0]
    changes = {k: gap_of(data, scales, nominal - predict(longer(data, k), Settings(1))[0]).total for k in (2, 3, 4)}
    assert chosen(0.5 * (changes[2] + changes[3])) == 2
    assert chosen(0.5 * (changes[3] + changes[4])) == 3


def test_costs_count_the_steps_of_the_model(data: Dataset) -> None:
    assert longer(data, 5).cost == data.cost


def test_a_robot_without_another_step_keeps_its_own() -> None:
    rover = DiffDrive("rover", WHEEL_RADIUS, TRACK_WIDTH)
    data = build_dataset([rover_run("run1", {}, 8.0, seed=1)], [rover], SIGMA)
    assert quickened(data, measure_scales(data), settings=PredictSettings()) is data


def test_a_checkpoint_refers_to_robots_with_longer_steps(data: Dataset, space: Space) -> None:
    robots = [b.robot for b in data.blocks]
    known = [data, space, *robots, *longer_steps_of(robots[0], PredictSettings()), *data.runs, space.robot]
    coarse = longer(data, 4)
    keep = Keeper(Checkpoint(), np.random.default_rng(0), known, lambda thing: NotImplemented)
    again = keep("search", lambda: coarse)
    assert again.blocks[0].robot is coarse.blocks[0].robot
    with pytest.raises(TypeError):
        pickle.dumps(robots[0])


def test_the_noise_floor_begins_where_the_models_own_steps_do(
    data: Dataset, space: Space, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Start states from longer steps may be far off near standstill, and would be taken for noise."""
    begun: list[Dataset] = []

    def recorded(windows: Dataset, settings: Settings) -> dict[str, np.ndarray]:
        begun.append(windows)
        return {}

    monkeypatch.setattr(noise_errors, "start_bias", recorded)
    scales, tuned = measure_scales(data), PredictSettings(longer_steps=LENIENT)
    assert quickened(data, scales, settings=tuned) is not data
    floor_of(data, scales, space.settings([HERE]), np.random.default_rng(0), settings=tuned)
    assert [block.own for windows in begun for block in windows.blocks] == [1] * len(data.blocks)
