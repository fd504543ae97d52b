"""The wheeled truth: gap-free without an effect, and each effect does what the table says."""

import math
from dataclasses import replace

import numpy as np
import pytest

from plants.blind_families.strength import planar_ratio
from plants.blind_families.wheeled.effects import (
    BASE_PLANTINGS,
    EVERY,
    LONG_PLANTINGS,
    PLANTINGS,
    Draw,
    PoseSensor,
    Rover,
    draw_effect,
)
from plants.blind_families.wheeled.setting import draw_setting, ratio, seen
from plants.blind_families.wheeled.setting import drive as driven
from plants.blind_families.wheeled.truth import WheeledTruth, simulate
from residual_mpc.blind.families import make_case
from residual_mpc.blind.levels import LEVELS

R, B = 0.05, 0.2
IDEAL = WheeledTruth(R, B, speed_scale=10.0)
T = np.arange(0, 8.001, 0.04)


def drive(truth, left, right):
    """The trajectory under constant wheel speeds, from rest at t = 0."""
    return simulate(truth, T, lambda k, x, y, theta: (left, right))


def planted(effect, strength=0.5, target=None, sign=1.0):
    rover, parameters = EVERY[effect].plant(Rover(IDEAL, PoseSensor()), Draw(effect, target, sign, 0.3), strength)
    return rover.truth, parameters


def test_without_an_effect_the_robot_drives_the_exact_arc():
    end = drive(IDEAL, 4.0, 6.0).pose(T)[-1]
    v, w = R * 5.0, R * 2.0 / B
    exact = [v / w * math.sin(w * T[-1]), v / w * (1 - math.cos(w * T[-1])), w * T[-1]]
    assert end == pytest.approx(exact, abs=1e-6)


def test_without_an_effect_nothing_is_left_of_the_gap():
    rng = np.random.default_rng(5)
    setting = draw_setting(LEVELS["none"], (), False, rng)
    assert ratio(setting.rover, setting) < 1e-3


def test_a_delay_shifts_the_motion_by_a_time_off_the_grid():
    truth, parameters = planted("command_delay", 0.3337)
    late = drive(truth, 5.0, 5.0).pose(T)[-1, 0]
    assert drive(IDEAL, 5.0, 5.0).pose(T)[-1, 0] - late == pytest.approx(R * 5.0 * parameters["delay"], rel=1e-6)


def test_a_lag_loses_the_way_of_its_time_constant():
    truth, parameters = planted("actuator_lag", 0.5)
    lost = drive(IDEAL, 5.0, 5.0).pose(T)[-1, 0] - drive(truth, 5.0, 5.0).pose(T)[-1, 0]
    assert lost == pytest.approx(R * 5.0 * parameters["time_constant"], rel=0.02)


def test_inside_its_play_a_motor_turns_and_the_robot_stands():
    truth, parameters = planted("backlash", 0.4)
    loose = replace(truth, gap=(2.0, 2.0))
    end = drive(loose, 0.1, 0.1)  # 0.8 rad in all, and the play begins in its middle
    assert end.motor[-1] == pytest.approx([0.1, 0.1]) and abs(end.pose(T)[-1, 0]) < 1e-9


def test_play_swallows_its_gap_when_the_wheels_reverse():
    truth, parameters = planted("backlash", 0.4)

    def there_and_back(k, x, y, theta):
        return (5.0, 5.0) if T[k] < 4.0 else (-5.0, -5.0)

    forth = simulate(truth, T, there_and_back, play=(-0.5, -0.5)).pose(T)
    ideal = simulate(IDEAL, T, there_and_back).pose(T)
    lag_forth = (ideal - forth)[95, 0]
    assert lag_forth == pytest.approx(R * parameters["gap"], rel=0.1)
    assert (ideal - forth)[-1, 0] == pytest.approx(0.0, abs=0.1 * R * parameters["gap"])


def test_saturation_bites_above_its_limit_alone():
    truth, parameters = planted("saturation", 0.5)
    slow, fast = 0.6 * parameters["limit"], 1.5 * parameters["limit"]
    assert drive(truth, slow, slow).motor[-1, 0] == pytest.approx(slow, rel=1e-3)
    assert drive(truth, fast, fast).motor[-1, 0] == pytest.approx(parameters["limit"], rel=0.02)


def test_a_dead_zone_swallows_small_commands_alone():
    truth, parameters = planted("dead_zone", 0.5)
    assert drive(truth, 0.9 * parameters["width"], 0.0).motor[-1, 0] == 0.0
    assert drive(truth, 1.1 * parameters["width"], 0.0).motor[-1, 0] == pytest.approx(1.1 * parameters["width"])


@pytest.mark.parametrize("direction", [1, -1])
def test_sideways_slip_drifts_outwards(direction):
    truth, parameters = planted("lateral_slip", 0.3)
    v, w = R * 4.0 * direction, R * 2.0 / B
    path = drive(truth, 4.0 * direction - 1.0, 4.0 * direction + 1.0)
    step = path.t[-1] - path.t[-2]
    sideways = (
        -math.sin(path.theta[-1]) * (path.x[-1] - path.x[-2]) + math.cos(path.theta[-1]) * (path.y[-1] - path.y[-2])
    ) / step
    assert sideways == pytest.approx(-parameters["coefficient"] * v * w, rel=0.05)


def test_a_slope_drifts_at_its_rate_and_heading():
    truth, parameters = planted("slope", 0.5)
    still = drive(truth, 0.0, 0.0).pose(T)[-1]
    assert math.hypot(still[0], still[1]) == pytest.approx(parameters["rate"] * T[-1], rel=0.1)
    assert math.atan2(still[1], still[0]) == pytest.approx(parameters["heading"], abs=1e-6)


def test_a_wheel_out_of_round_swings_about_its_mean_once_a_turn():
    truth, parameters = planted("wheel_eccentricity", 0.5, "left")
    swing = drive(truth, 5.0, 0.0).pose(T)[:, 2] - drive(IDEAL, 5.0, 0.0).pose(T)[:, 2]
    assert np.ptp(swing) == pytest.approx(2 * parameters["amplitude"] * R / B, rel=0.1)
    turn = round(2 * np.pi / 5.0 / 0.04)
    assert np.abs(swing[turn:] - swing[:-turn]).max() < 0.05 * np.ptp(swing)


def test_its_wheels_stand_at_another_angle_in_each_run():
    rng = np.random.default_rng(8)
    setting = draw_setting(LEVELS["long"], ("wheel_eccentricity",), False, rng)
    whole = setting.plans[0]
    plan = replace(whole, t=whole.t[:200], forward=whole.forward[:200], yaw=whole.yaw[:200])
    uneven = EVERY["wheel_eccentricity"].plant(setting.rover, Draw("wheel_eccentricity", "left", 1.0, 0.0), 0.5)[0]
    first, second = (driven(uneven, setting, replace(plan, name=name), (0.0, 0.0)).theta for name in ("run1", "run2"))
    assert np.abs(first - second).max() > 0.01
    plain = [driven(setting.rover, setting, replace(plan, name=n), (0.0, 0.0)).theta for n in ("run1", "run2")]
    assert np.array_equal(*plain)


@pytest.mark.parametrize("rate", [0.01, -0.01])
def test_a_skewed_clock_is_off_by_its_rate_at_the_end(rate):
    path = drive(IDEAL, 5.0, 5.0)
    shown = seen(path, T, PoseSensor(skew=rate))[:, 0]
    off = (path.pose(T)[:, 0] - shown) / (R * 5.0)  # s
    assert off[-1] == pytest.approx(T[-1] * rate / (1 + rate), abs=1e-3) and abs(off[0]) < 1e-3


@pytest.mark.parametrize("effect", sorted(LONG_PLANTINGS))
def test_what_takes_a_long_run_adds_to_the_gap(effect):
    rng = np.random.default_rng(3)
    setting = draw_setting(LEVELS["long"], (effect,), False, rng)
    setting = replace(setting, plans=setting.plans[:2])
    draw = draw_effect(effect, setting.encoders, rng)
    assert ratio(EVERY[effect].plant(setting.rover, draw, 0.6)[0], setting) > 1.0
    assert ratio(EVERY[effect].plant(setting.rover, draw, 0.005)[0], setting) < 0.6


def test_a_base_controller_turns_less_at_the_same_forward_speed():
    truth, parameters = planted("turn_gain", 0.5)
    path, ideal = drive(truth, 3.0, 6.0), drive(IDEAL, 3.0, 6.0)
    speeds, meant = (np.diff(p.pose(T)[-2:], axis=0)[0] for p in (path, ideal))
    assert speeds[2] == pytest.approx(parameters["gain"] * meant[2], rel=1e-3)
    assert np.hypot(*speeds[:2]) == pytest.approx(np.hypot(*meant[:2]), rel=1e-3)


def test_a_limited_turn_keeps_the_forward_speed():
    truth, parameters = planted("turn_limit", 0.9)
    motor = drive(truth, 2.0, 2.0 + 6.0 * parameters["limit"]).motor[-1]
    assert 0.5 * (motor[1] - motor[0]) == pytest.approx(parameters["limit"], rel=1e-3)
    assert 0.5 * (motor[1] + motor[0]) == pytest.approx(2.0 + 3.0 * parameters["limit"], rel=1e-3)


def test_wheels_that_share_a_limit_keep_their_ratio():
    truth, parameters = planted("shared_limit", 0.9)
    motor = drive(truth, parameters["limit"], 4.0 * parameters["limit"]).motor[-1]
    np.testing.assert_allclose(motor, [0.25 * parameters["limit"], parameters["limit"]], rtol=1e-3)


@pytest.mark.parametrize("effect", sorted(BASE_PLANTINGS))
def test_what_a_base_controller_does_adds_to_the_gap(effect):
    rng = np.random.default_rng(3)
    setting = draw_setting(LEVELS["base"], (effect,), False, rng)
    assert setting.encoders or effect != "turn_gain"
    setting = replace(setting, plans=setting.plans[:2])
    draw = draw_effect(effect, setting.encoders, rng)
    assert ratio(EVERY[effect].plant(setting.rover, draw, 0.9)[0], setting) > 1.0
    assert ratio(EVERY[effect].plant(setting.rover, draw, 0.005)[0], setting) < 0.6


@pytest.mark.parametrize("effect", sorted(set(PLANTINGS) - {"sensor_outliers"}))
def test_every_effect_adds_to_the_gap_and_none_at_no_strength(effect):
    rng = np.random.default_rng(3)
    setting = draw_setting(LEVELS["single"], (effect,), False, rng)
    setting = replace(setting, plans=setting.plans[:3])
    draw = draw_effect(effect, setting.encoders, rng)
    assert ratio(PLANTINGS[effect].plant(setting.rover, draw, 0.6)[0], setting) > 1.0
    if effect != "saturation":  # whose soft knee is felt below its limit
        assert ratio(PLANTINGS[effect].plant(setting.rover, draw, 0.01)[0], setting) < 0.6


def test_the_second_opinion_on_the_gap_sees_a_wrong_radius_as_its_share_of_the_motion():
    path = drive(IDEAL, 5.0, 5.0)
    run = (T, path.pose(T), path.command)
    small, large = (planar_ratio([run], R * (1 + e), B, (0.002, 0.005)) for e in (0.05, 0.10))
    assert large == pytest.approx(2 * small, rel=0.01)


def test_the_same_seed_gives_the_same_files_and_another_level_does_not(tmp_path):
    for name in ("a", "b"):
        make_case("wheeled", "none", 7, tmp_path / name)
    make_case("wheeled", "noisy_none", 7, tmp_path / "c")
    files = [sorted((tmp_path / n / "case").iterdir()) for n in "abc"]
    a, b, c = ([p.read_bytes() for p in f] for f in files)
    assert a == b and a != c
