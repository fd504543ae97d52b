"""An effect whose size differs from run to run, or that begins or ends in mid-run, says so; a steady one does not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from diagnosis.linear import GAIN, SCALE, Linear, fitted, space_of, windows
from oracles.rover_log import ROBOT, rover_run, write_run

import residual_mpc as rm
from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.gap import measure_scales
from residual_mpc.diagnosis.results.divisions import divisions_of_effect
from residual_mpc.diagnosis.results.settings import ResultSettings
from residual_mpc.diagnosis.results.variation import variations_on
from residual_mpc.diagnosis.results.variation_records import Variation
from residual_mpc.models.settings import Knob, Term

PARAMETER = {"actuator_gain": "gain", "sensor_scale": "scale"}
ONLY = ("command_delay", "track_width", "actuator_gain")


def diagnosed(folder: Path, effect: str, parameter: str, sizes: list[float]) -> dict[str, Any]:
    """The only named effect of a rover that has it in these sizes, run by run."""
    (folder / "robot.toml").write_text(ROBOT)
    robot = rm.load_robot(folder / "robot.toml")
    runs = [rover_run(f"run{k}", {effect: {parameter: x}}, seconds=12.0, seed=k) for k, x in enumerate(sizes)]
    found = rm.diagnose(robot, rm.read_runs(robot, [write_run(r, folder) for r in runs]), only=ONLY)
    (cause,) = found.explanation
    assert cause["effect"] == effect
    return cause


def test_sizes_of_runs_are_stated_where_they_differ(tmp_path: Path) -> None:
    sizes = [1.1, 1.4, 1.2, 1.35]
    cause = diagnosed(tmp_path, "track_width", "scale", sizes)
    assert list(cause["by_run"]) == [f"run{k}" for k in range(4)] and "since" not in cause
    np.testing.assert_allclose(list(cause["by_run"].values()), sizes, atol=0.03)


@pytest.mark.slow
def test_a_steady_effect_has_no_sizes_of_runs(tmp_path: Path) -> None:
    cause = diagnosed(tmp_path, "command_delay", "delay", [0.1] * 4)
    assert not {"by_run", "since", "until"} & set(cause)


@pytest.mark.parametrize(("sizes", "key", "run"), [
    pytest.param([1.0, 1.0, 0.7, 0.7], "since", "run2", marks=pytest.mark.slow),
    pytest.param([0.7, 0.7, 0.7, 1.0], "until", "run3", marks=pytest.mark.slow),
])  # fmt: skip
def test_an_effect_that_begins_or_ends_says_when(tmp_path: Path, sizes: list[float], key: str, run: str) -> None:
    cause = diagnosed(tmp_path, "actuator_gain", "gain", sizes)
    assert set(cause) & {"by_run", "since", "until"} == {key}
    assert cause[key]["run"] == run and cause[key]["t"] == pytest.approx(0.0, abs=1.0)


DATA = windows(6, 12.0)


def linear(
    change: np.ndarray, seed: int = 0, data: Dataset = DATA, one: Knob = SCALE, other: Knob = GAIN
) -> dict[Term, Variation]:
    """The variations of two effects, one of which has a size of its own in each window: 1.4 + change (W,)."""
    rng = np.random.default_rng(seed)
    columns = {k: 4.0 * rng.standard_normal((DATA.count, 20)) for k in (one, other)}
    noise = rng.standard_normal((DATA.count, 20)) - columns[one] * change[:, None]
    problem: Any = Linear(data, space_of(DATA), columns, {one: 1.4, other: 0.8}, noise)
    fit = fitted(problem, {one: 1.0, other: 1.0})
    return variations_on(problem, fit, [one.term, other.term], measure_scales(DATA), ResultSettings())[0]


def motion() -> np.ndarray:
    """(W,) the third of the windows, by the size of their motion."""
    moved = (DATA.y - DATA.y[:, :1]) / measure_scales(DATA).motion
    size = np.nanmean(moved**2, axis=(1, 2))
    return np.searchsorted(np.quantile(size, (1 / 3, 2 / 3)), size)


def test_a_size_that_grows_with_the_motion_is_stated_in_thirds() -> None:
    found = linear(np.array([-0.2, 0.0, 0.2])[motion()])
    assert set(found) == {SCALE.term}  # what does not vary is not said to
    sizes = found[SCALE.term].by_motion
    assert sizes is not None and list(sizes) == ["small", "medium", "large"]
    np.testing.assert_allclose(list(sizes.values()), [1.2, 1.4, 1.6], atol=0.03)


@pytest.mark.parametrize("effect", ["actuator_gain [left]", "sensor_scale [position.left]"])
def test_a_size_that_depends_on_where_the_joint_is_is_stated_in_thirds(effect: str) -> None:
    name, target = effect.removesuffix("]").split(" [")
    on_left, on_right = (Knob(name, target.replace("left", side), PARAMETER[name]) for side in ("left", "right"))
    names = {"pose.x": "position.left", "pose.y": "position.right"}
    data = replace(DATA, channels=tuple(names.get(c, c) for c in DATA.channels))
    place = np.nanmean(data.y[:, :, data.channels.index("position.left")], axis=1)
    third = np.searchsorted(np.quantile(place, (1 / 3, 2 / 3)), place)
    found = linear(np.array([-0.3, 0.0, 0.3])[third], data=data, one=on_left, other=on_right)
    assert set(found) == {on_left.term}
    sizes = found[on_left.term].by_position
    assert sizes is not None and list(sizes) == ["low", "middle", "high"]
    np.testing.assert_allclose(list(sizes.values()), [1.1, 1.4, 1.7], atol=0.04)
    assert found[on_left.term].document() == {"by_position": sizes}


def test_a_limit_that_some_runs_do_not_show_has_no_size_there() -> None:
    limit = Knob("rate_limit", "left", "rate")
    last = DATA.run * 100.0 + DATA.start
    one = replace(DATA, run=np.where(last < last.max(), 0, 1))
    found = linear(np.where(one.run == 0, 0.0, 60.0), data=one, one=limit)
    variation = found[limit.term]
    assert list(variation.by_run or ()) == ["r0"] and variation.free == ("r1",) and variation.doubtful
    assert variation.document()["free"] == ["r1"] and "r1" not in variation.document()["by_run"]


def test_a_run_that_hardly_shows_an_effect_has_no_size() -> None:
    """The size that would suit it best is far from any other, and says nothing."""
    rng = np.random.default_rng(2)
    columns = {k: 4.0 * rng.standard_normal((DATA.count, 20)) for k in (SCALE, GAIN)}
    columns[SCALE][DATA.run == 0] *= 1e-3
    change = np.array([0.0, 0.3, -0.3, 0.3, -0.3, 0.3])[DATA.run]
    noise = rng.standard_normal((DATA.count, 20)) - columns[SCALE] * change[:, None]
    problem: Any = Linear(DATA, space_of(DATA), columns, {SCALE: 1.4, GAIN: 0.8}, noise)
    fit = fitted(problem, {SCALE: 1.4, GAIN: 0.8})
    sizes = variations_on(problem, fit, [SCALE.term], measure_scales(DATA), ResultSettings())[0][SCALE.term].by_run
    assert sizes is not None and list(sizes) == [f"r{k}" for k in range(1, 6)]


def test_an_effect_that_moves_no_prediction_is_steady() -> None:
    """As a limit that the runs do not reach at the size that fits them."""
    columns = {SCALE: np.zeros((DATA.count, 20)), GAIN: np.ones((DATA.count, 20))}
    noise = np.random.default_rng(0).standard_normal((DATA.count, 20))
    problem: Any = Linear(DATA, space_of(DATA), columns, {SCALE: 1.4, GAIN: 0.8}, noise)
    fit = fitted(problem, {SCALE: 1.4, GAIN: 1.0})
    assert variations_on(problem, fit, [SCALE.term, GAIN.term], measure_scales(DATA), ResultSettings())[0] == {}


def test_a_joint_whose_position_is_not_logged_has_no_thirds() -> None:
    for knob in (SCALE, Knob("actuator_gain", "left", "gain")):
        for variation in linear(np.array([-0.3, 0.0, 0.3])[motion()], one=knob).values():
            assert variation.by_position is None


def test_the_only_joint_of_a_robot_needs_no_name() -> None:
    data = replace(DATA, channels=tuple({"pose.x": "position.shaft"}.get(c, c) for c in DATA.channels))
    of = data, Term("viscous_friction", None), np.arange(data.count)
    kinds = [d.kind for d in divisions_of_effect(*of, ("shaft",))]
    assert kinds == ["by_influence", "by_position"]
    for division in divisions_of_effect(*of, ("shaft",)):
        assert division.parts.shape == (3, data.count) and (division.parts.sum(axis=0) == 1).all()
    assert [d.kind for d in divisions_of_effect(*of, ("shaft", "tip"))] == ["by_influence"]


def acting(strength: np.ndarray, change: np.ndarray) -> Variation:
    """Of an effect that changes the prediction of each window by its strength (W,), with a size of its own in each:
    1.4 + change (W,)."""
    rng = np.random.default_rng(0)
    columns = {k: 4.0 * rng.standard_normal((DATA.count, 160)) for k in (SCALE, GAIN)}
    columns[SCALE] *= strength[:, None]
    noise = rng.standard_normal((DATA.count, 160)) - columns[SCALE] * change[:, None]
    problem: Any = Linear(DATA, space_of(DATA), columns, {SCALE: 1.4, GAIN: 0.8}, noise)
    fit = fitted(problem, {SCALE: 1.0, GAIN: 1.0})
    return variations_on(problem, fit, [SCALE.term, GAIN.term], measure_scales(DATA), ResultSettings())[0][SCALE.term]


def test_a_size_that_grows_with_the_influence_is_stated_in_thirds() -> None:
    """Whatever runs the windows are in, and however large the motion is there."""
    strength = np.random.default_rng(1).permutation(np.linspace(0.5, 2.0, DATA.count))
    sizes = acting(strength, 0.4 * (strength - 1.25)).by_influence
    assert sizes is not None and list(sizes) == ["weak", "medium", "strong"]
    assert sizes["weak"] < 1.4 < sizes["strong"]


def test_runs_that_differ_in_the_influence_alone_do_not_differ_as_runs() -> None:
    """Each run has windows of its own strength, and within it the size follows the strength too."""
    run = np.searchsorted(np.unique(DATA.run), DATA.run)
    strength = 0.6 + 0.25 * run + np.random.default_rng(2).uniform(-0.2, 0.2, DATA.count)
    found = acting(strength, 0.8 * (strength - strength.mean()))
    assert found.by_run is None and found.by_influence is not None
    assert found.by_state and found.doubtful


def test_what_does_not_vary_is_steady_at_the_stated_rate() -> None:
    assert sum(bool(linear(np.zeros(DATA.count), seed)) for seed in range(40)) == 0


def test_an_effect_that_begins_in_mid_run_says_at_which_window() -> None:
    begun = (DATA.run > 3) | ((DATA.run == 3) & (DATA.start >= 5.0))
    found = linear(np.where(begun, 0.0, -0.4))
    at = found[SCALE.term].since
    assert at is not None and at.run == "r3" and at.t == pytest.approx(5.0, abs=1.0)
    assert found[SCALE.term].by_run is None
