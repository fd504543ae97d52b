"""A hidden robot that plays somebody else's commands: its own sensors, its own truth, and nothing besides."""

import numpy as np
import pandas as pd
import pytest
from arm_settings import single_arm

from plants.blind_families.arm.family import ArmBench
from plants.blind_families.wheeled.family import WheeledBench
from plants.blind_families.wheeled.setting import draw_setting
from residual_mpc.blind.commanded_motion import CommandedMotion
from residual_mpc.blind.families import make_case, make_hidden_robot
from residual_mpc.blind.levels import LEVELS
from residual_mpc.blind.seal import digest

T = 0.04 * np.arange(126)


def rover(sensors=()) -> tuple[WheeledBench, CommandedMotion]:
    setting = draw_setting(LEVELS["confounded"], ("slope",), True, np.random.default_rng(3))
    wheel = 0.5 * setting.rover.truth.speed_scale * np.ones(len(T))
    commands = {"right": wheel, "left": 0.5 * wheel}
    return WheeledBench(setting, (), True), CommandedMotion("arc", T, commands, {}, tuple(sensors))


def logged(bench, asked, folder, seed=0):
    folder.mkdir()
    assert bench.play(bench.robot, asked, np.random.default_rng(seed), "next1", folder)
    (path,) = folder.iterdir()
    return pd.read_csv(path) if path.suffix == ".csv" else pd.read_parquet(path)


def test_a_rover_drives_what_is_asked(tmp_path):
    bench, asked = rover()
    run, truth = logged(bench, asked, tmp_path / "a"), bench.robot.truth
    np.testing.assert_allclose(run["command.right"], asked.commands["right"], rtol=1e-6)
    turned = truth.wheel_radius * 0.5 * asked.commands["right"][0] * T[-1] / truth.track_width
    assert run["pose.theta"].iloc[-1] == pytest.approx(turned, abs=5 * bench.setting.sigma[1])
    assert "velocity.left" not in run
    pd.testing.assert_frame_equal(run, logged(bench, asked, tmp_path / "b"))
    assert not np.allclose(run["pose.x"], logged(bench, asked, tmp_path / "c", seed=1)["pose.x"])


def test_encoders_are_logged_where_they_are_asked_for(tmp_path):
    bench, asked = rover(["velocity.left", "velocity.right"])
    run = logged(bench, asked, tmp_path / "a")
    noise = bench.setting.encoder_sigma
    assert run["velocity.right"].iloc[20:].mean() == pytest.approx(asked.commands["right"][0], abs=noise)


def test_an_arm_plays_commands_and_has_its_motors_off(tmp_path):
    setting = single_arm(5)
    assert setting.robot.truth.arm.kind == "position" and not setting.drops
    arm = setting.robot.truth.arm
    t = 0.02 * np.arange(51)
    off = np.where(t > 0.5, 0.0, 1.0)
    commands = {j: arm.home[k] + 0.1 * np.sin(t) for k, j in enumerate(arm.joints)}
    motion = CommandedMotion("m", t, commands, dict.fromkeys(arm.joints, off))
    run = logged(ArmBench(setting, ()), motion, tmp_path / "a")
    first = arm.joints[0]
    np.testing.assert_allclose(run[f"command.{first}"], commands[first], rtol=1e-6)
    np.testing.assert_array_equal(run[f"enabled.{first}"], off)
    assert run[f"position.{first}"].iloc[0] == pytest.approx(arm.home[0], abs=0.01)
    plain = logged(ArmBench(setting, ()), CommandedMotion("m", t, commands, {}), tmp_path / "b")
    assert f"enabled.{first}" not in plain


def test_the_twin_of_a_case_is_the_robot_of_that_case(tmp_path):
    answer = make_case("wheeled", "none", 7, tmp_path / "a")
    twin = make_hidden_robot("wheeled", "none", 7, tmp_path / "b")
    assert twin.answer == answer and digest(tmp_path / "a" / "case") == digest(tmp_path / "b" / "case")
