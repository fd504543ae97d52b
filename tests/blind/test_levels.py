"""The harder levels: what they hide is in the range that they state, and nothing of it travels with the case."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from plants.blind_families.arm.family import HABITS as OF_ARMS
from plants.blind_families.arm.flaws import ArmFlaws
from plants.blind_families.hide import AT_ONCE, NEEDED, NOTICED, hide
from plants.blind_families.sensing import draw_wild, stamped, stamps
from plants.blind_families.wheeled.effects import PLANTINGS, Draw, PoseSensor, Rover
from plants.blind_families.wheeled.family import HABITS as OF_ROVERS
from plants.blind_families.wheeled.family import _bench
from plants.blind_families.wheeled.faults import caused, changing
from plants.blind_families.wheeled.setting import draw_setting, ratio
from plants.blind_families.wheeled.truth import WheeledTruth, simulate
from residual_mpc.blind.families import make_case
from residual_mpc.blind.levels import LEVELS
from residual_mpc.blind.suite import FIRST_TEST_SEED
from residual_mpc.effects.library import BY_NAME

T = np.arange(0, 6.001, 0.04)
HIDDEN = set(BY_NAME) - {"wheel_radius", "track_width"}  # which the nominal model has as well


def hidden(name, seed, runs=2):
    """What the level hides in a rover that makes two runs alone, and the bench that it was put on."""
    level = LEVELS[name]
    for attempt in range(12):
        rng = np.random.default_rng([seed, attempt])
        bench = _bench(level, rng)
        bench = replace(bench, setting=replace(bench.setting, plans=bench.setting.plans[:runs]))
        found = hide(bench, level, seed, rng)
        if found is not None:
            return bench, found
    raise AssertionError("nothing could be hidden")


@pytest.mark.parametrize("seed", [1])
def test_each_of_a_pair_is_needed(seed):
    bench, found = hidden("confusable", seed)
    low, high = LEVELS["confusable"].ratio
    assert tuple(p.effect for p in found.effects) in OF_ROVERS.pairs
    assert all(low <= p.ratio <= high for p in found.effects) and min(found.notes["alone"]) >= NEEDED
    assert not found.unknown and not found.background


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_no_constant_effect_does_what_one_does_that_comes_and_goes(seed):
    bench, found = hidden("changed", seed, runs=3)
    low, high = LEVELS["changed"].rest
    assert not found.effects and len(found.background) == len(found.unknown) == 1
    assert low <= found.notes["rest"] <= high and found.notes["rest_gap"] >= NOTICED
    assert found.unknown[0].split()[0] == found.background[0].effect


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_slow_effects_are_under_the_noise_over_a_second(seed):
    bench, found = hidden("slow", seed)
    low, high = LEVELS["slow"].ratio
    assert found.notes["at_once"] <= AT_ONCE and all(low <= p.ratio <= high for p in found.effects)
    assert bench.ratio(found.robot) > bench.ratio(found.robot, 1.0)


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_beside_flaws_a_gap_stays_with_the_right_names(seed):
    bench, found = hidden("misspecified", seed)
    low, high = LEVELS["misspecified"].rest
    assert low <= found.notes["rest"] <= high and found.unknown == bench.flaws
    names = {p.effect for p in found.background}
    assert found.effects and not names & {p.effect for p in found.effects} and names <= set(BY_NAME)
    assert all(p.ratio >= 0.7 * found.notes["rest"] for p in found.effects)


@pytest.mark.parametrize("habits", [OF_ROVERS, OF_ARMS])
def test_causes_without_a_name_are_others_in_tests(habits):
    assert len(habits.unnamed_in_tests) >= 4 and not set(habits.unnamed) & set(habits.unnamed_in_tests)
    assert not {*habits.unnamed, *habits.unnamed_in_tests} & set(BY_NAME)


def test_a_test_seed_draws_the_causes_of_tests():
    for seed, causes in ((5, OF_ROVERS.unnamed), (FIRST_TEST_SEED, OF_ROVERS.unnamed_in_tests)):
        bench, found = hidden("unknown", seed, runs=1)
        assert len(found.unknown) == 1 and found.unknown[0] in causes


@pytest.mark.parametrize("cause", sorted({*OF_ROVERS.unnamed, *OF_ROVERS.unnamed_in_tests}))
def test_every_cause_adds_to_the_gap_and_none_at_no_strength(cause):
    rng = np.random.default_rng(3)
    setting = draw_setting(LEVELS["unknown"], (), False, rng)
    setting = replace(setting, plans=setting.plans[:1])
    of = caused(cause, setting.rover, rng)
    assert ratio(of(0.6), setting) > 2.0 and ratio(of(0.0), setting) < 1e-2


def test_an_effect_that_begins_is_absent_before_and_there_afterwards():
    base = Rover(WheeledTruth(0.05, 0.2, speed_scale=10.0), PoseSensor())
    draw = Draw("actuator_gain", None, -1.0, 0.0)
    runs = [(f"run{k + 1}", 6.0) for k in range(5)]
    ways = {}
    for seed in range(12):
        words, of = changing(draw, base, runs, np.random.default_rng(seed))
        ways.setdefault(words.split()[0], (words, of))
    assert set(ways) == {"begins", "ends", "differs"}
    weak = PLANTINGS["actuator_gain"].plant(base, draw, 0.5)[0].truth
    for way, first in (("begins", base.truth), ("ends", weak)):
        words, of = ways[way]
        robot = of(0.5)
        number = int(words.split(" in run")[1].split()[0])
        assert robot.at("run1")[0].truth == first and robot.at("run5")[0].truth == (
            weak if way == "begins" else base.truth
        )
        began, (since, after) = robot.at(f"run{number}")
        drive = simulate(began.truth, T, lambda k, x, y, theta: (4.0, 4.0), change=(since, after.truth))
        speed = np.diff(drive.pose(T)[:, 0]) / np.diff(T) / (0.05 * 4.0)
        early, late = (0.8, 1.0) if way == "ends" else (1.0, 0.8)
        assert speed[2] == pytest.approx(early, rel=1e-3) and speed[-1] == pytest.approx(late, rel=1e-3)
    assert ways["differs"][1](0.5).at("run1") != ways["differs"][1](0.5).at("run5")


@pytest.mark.parametrize("rate", [10.0, 1000.0])
def test_late_stamps_increase_and_are_late_by_nothing_on_average(rate):
    rng = np.random.default_rng(4)
    rough = replace(draw_wild(rate, 0.002, rng), late=0.2 / rate)
    t = stamps(20.0, rate, rough, rng)
    called = stamped(t, 1, rough, rng) - rough.origins[1 % len(rough.origins)]
    assert np.all(np.diff(called) > 0) and abs(np.mean(called - t)) < 0.05 / rate


def test_no_file_of_a_rough_case_tells_its_level(tmp_path):
    answers = [make_case("wheeled", "rough_none", seed, tmp_path / str(seed)) for seed in (41001, 41003)]
    for answer in answers:
        folder = tmp_path / str(answer.seed) / "case"
        assert not answer.effects and {p.effect for p in answer.background} <= {"sensor_outliers"}
        assert answer.notes["ratio"] < 0.01  # the robot is perfect
        text = (folder / "robot.toml").read_text()
        assert not any(word in text for word in ("rough", "none", "wild", *HIDDEN))
        assert not (folder.parent / "clean").exists()
        for path in sorted(folder.glob("run*")):
            run = pd.read_csv(path) if path.suffix == ".csv" else pd.read_parquet(path)
            kinds = {"t", "command.left", "command.right", "pose.x", "pose.y", "pose.theta"}
            assert set(run.columns) - kinds <= {"velocity.left", "velocity.right"}
            assert (np.diff(run["t"]) > 0).all() and run["command.left"].notna().all()


def test_a_misspecified_case_is_a_rover_as_any_other(tmp_path):
    answer = make_case("wheeled", "misspecified", 41001, tmp_path)
    assert answer.effects and answer.unknown and "best_fit" not in answer.notes
    words = "".join(p.read_text() for p in sorted((tmp_path / "case").iterdir()) if p.suffix in (".toml", ".csv"))
    assert not any(word in words for word in ("misspecified", *answer.unknown, *HIDDEN))


def test_flaws_of_an_arm_do_nothing_by_default_and_what_they_say_otherwise():
    v = np.array([[1.0, 1.0, -0.25]])
    q = np.zeros_like(v)
    assert np.all(ArmFlaws().pull(q, v) == 0.0) and np.all(ArmFlaws().driven(v) == v)
    rooted = ArmFlaws(rooted=2.0 * np.ones(3)).pull(q, v)
    np.testing.assert_allclose(rooted, [[-2.0, -2.0, 1.0]], rtol=1e-3)
    belt = ArmFlaws(belt=np.array([0.0, 4.0])).pull(q, v)
    np.testing.assert_allclose(belt, [[0.0, -5.0, 5.0]])  # it drags the slower joint along
    assert np.all(np.abs(ArmFlaws(soft=0.5).driven(10.0 * v)) < np.abs(10.0 * v))
