"""Four wheels on contacts: they roll, they skid in turns, and their drives have the effects of a rover's."""

from dataclasses import replace

import numpy as np
import pytest
from answers import answer

from plants.blind_families.skid.family import DESCRIBED, FAMILY, PLANTINGS
from plants.blind_families.skid.truth import Skidder
from plants.blind_families.wheeled.truth import WheeledTruth
from residual_mpc.blind.levels import LEVELS
from residual_mpc.blind.score.match import where

T = np.arange(0, 6.001, 0.04)
SKIDDER = Skidder(0.067, 0.3, 0.25, 0.8)


def skid(left, right, size=1.0, **more):
    robot = replace(SKIDDER, wheel_radius=0.067 * size, track_width=0.3 * size, wheelbase=0.25 * size)
    truth = WheeledTruth(robot.wheel_radius, robot.track_width, speed_scale=10.0, **more)
    t = T * size**0.5
    return t, robot.simulate(truth, t, lambda k, x, y, theta: (left, right)).pose(t)


@pytest.mark.parametrize("size", [0.1, 1.0, 4.6])
def test_four_wheels_roll_straight_and_skid_in_turns(size):
    t, straight = skid(4.0 / size**0.5, 4.0 / size**0.5, size)
    assert straight[-1, 0] == pytest.approx(0.067 * size**0.5 * 4.0 * t[-1], rel=0.05)
    assert abs(straight[-1, 2]) < 0.02
    t, turn = skid(-4.0 / size**0.5, 4.0 / size**0.5, size)
    by_tape = 0.067 * size * 8.0 / size**0.5 / (0.3 * size) * t[-1]
    assert 0.3 * by_tape < turn[-1, 2] < 0.9 * by_tape


def test_drives_of_a_skidding_robot_have_the_effects_of_a_rover():
    t, plain = skid(4.0, 4.0)
    _, late = skid(4.0, 4.0, delay=(0.2, 0.2))
    assert plain[-1, 0] - late[-1, 0] == pytest.approx(0.067 * 4.0 * 0.2, rel=0.1)
    _, uneven = skid(4.0, 4.0, radius=(1.0, 1.1))
    assert uneven[-1, 2] > 0.1


def test_its_drives_speed_up_at_a_limited_rate():
    """A larger step takes longer, as with a rate limit, which it therefore does not lack; with a lag it would not."""

    def rise_time(speed):
        truth = WheeledTruth(SKIDDER.wheel_radius, SKIDDER.track_width, speed_scale=10.0)
        happened = SKIDDER.simulate(truth, T, lambda k, x, y, theta: (0.0, 0.0) if T[k] < 1.0 else (speed, speed))
        wheel = happened.motor.mean(axis=1)
        return happened.t[np.argmax(wheel > 0.8 * speed)] - happened.t[np.argmax(wheel > 0.2 * speed)]

    assert rise_time(12.0) == pytest.approx(3.0 * rise_time(4.0), rel=0.15)
    assert "rate_limit" in DESCRIBED


def test_its_levels_are_known_and_its_places_are_those_of_a_rover():
    assert set(FAMILY.levels) <= set(LEVELS) and not {"slope", "lateral_slip", "track_width"} & set(PLANTINGS)
    truth = answer(("actuator_lag", "left"), family="skid_steer", traits=("wheeled", "encoders"))
    assert where(truth, "actuator_lag", None) == {"left", "right"}
    assert where(truth, "sensor_bias", None) == {"pose.theta"}
