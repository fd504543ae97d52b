"""Sensors, and the twin whose withheld effects show in the runs and are named nowhere but in the truth."""

import json
from dataclasses import replace

import numpy as np
import pytest

from plants.sensors import Sensed, Sensor
from plants.simulator import Recording, record
from plants.wheeled import Geometry, bullet_drive, mujoco_drive
from plants.wheeled.motions import back_and_forth, constant_yaw_rate, policy
from plants.wheeled.twin import Withheld, camera, draw_withheld, encoders, noisy, twin
from residual_mpc.errors import BadInput

PERIOD = 1.0 / 30.0
EIGHT = policy(constant_yaw_rate(0.6, 0.12), Geometry(), PERIOD)


def run(simulator, seconds=4.0, seed=0, drive=EIGHT):
    return record(simulator, drive, Recording(seconds, PERIOD, {}), np.random.default_rng(seed))


def test_without_noise_a_sensor_is_exact():
    exact = run(mujoco_drive())
    seen = run(Sensed(mujoco_drive(), (Sensor({"pose.x": 0.0, "velocity.left": 0.0}),)))
    assert list(seen.columns) == ["t", "command.left", "command.right", "pose.x", "velocity.left"]
    assert np.array_equal(seen["pose.x"], exact["pose.x"])


def test_noise_is_as_large_as_stated_and_moves_no_robot():
    exact, seen = run(mujoco_drive(), 20.0), run(noisy(mujoco_drive()), 20.0)
    for channel, sigma in {**camera().sigma, **encoders().sigma}.items():
        error = seen[channel] - exact[channel]
        assert error.std() == pytest.approx(sigma, rel=0.15), channel
        assert abs(error.mean()) < 0.25 * sigma, channel


def test_a_slow_sensor_reports_once_a_period():
    slow = Sensed(mujoco_drive(), (Sensor({"pose.x": 0.0}, period=0.1), Sensor({"velocity.left": 0.0})))
    table = record(slow, EIGHT, Recording(2.0, 0.02, {}), np.random.default_rng(0))
    fresh = table["pose.x"].notna().to_numpy()
    assert (np.flatnonzero(fresh) == np.arange(0, 101, 5)).all()
    assert table["velocity.left"].notna().all()


def test_spikes_and_losses_come_at_their_rates():
    sensor = replace(camera(spikes=1.0), loss=0.1)
    exact = run(mujoco_drive(), 120.0)
    seen = run(Sensed(mujoco_drive(), (sensor,)), 120.0)
    far = (seen["pose.x"] - exact["pose.x"]).abs() > 0.02
    # 120 expected, of which 10 % are lost and 10 % are too small to be seen
    assert 70 < far.sum() < 125
    assert seen["pose.x"].isna().mean() == pytest.approx(0.1, abs=0.02)
    np.testing.assert_array_equal(seen["pose.x"].isna(), seen["pose.theta"].isna())


@pytest.mark.parametrize(
    "sensor", [{"sigma": {"pose.x": -1.0}}, {"sigma": {}, "spikes": 1.0}, {"sigma": {"pose.x": 0.0}, "loss": 1.0}]
)
def test_a_sensor_that_cannot_be_is_refused(sensor):
    with pytest.raises(BadInput):
        Sensor(**sensor)


def test_a_sensor_of_a_channel_that_is_not_there_is_refused():
    with pytest.raises(BadInput, match=r"position\.left"):
        Sensed(mujoco_drive(), (Sensor({"position.left": 0.0}),))


def test_a_twin_without_anything_withheld_is_the_simulator():
    sensors = (replace(camera(0.0), spike=None, loss=0.0), encoders())
    a, b = run(twin(mujoco_drive(), Withheld(), sensors)), run(noisy(mujoco_drive()))
    assert np.array_equal(a, b)


def test_the_withheld_shows_in_either_engine_alike():
    """A smaller right wheel and a wider track than the model's: the yaw rate that they give, in both engines."""
    withheld = Withheld(ratio=0.95, track=1.1)
    expected = 0.033 * (0.95 - 1.0) * 4.0 / (0.16 * 1.1)
    for make in (mujoco_drive, bullet_drive):
        robot = twin(make(), withheld, (Sensor({"twist.theta": 0.0}),))
        table = run(robot, 2.0, drive=lambda t, reading: np.array([4.0, 4.0]))
        assert table["twist.theta"].iloc[-1] == pytest.approx(expected, rel=0.01)


def test_a_sticking_wheel_turns_the_robot_that_drives_slowly():
    withheld = Withheld(static=0.05, kinetic=0.025, sticking=1)
    robot = twin(mujoco_drive(), withheld, (Sensor({"pose.theta": 0.0}),))
    drive = policy(back_and_forth(0.05, 8.0), Geometry(), PERIOD)
    assert run(robot, 4.0, drive=drive)["pose.theta"].min() < -0.1  # the right wheel stays behind: a turn to the right


def test_the_same_seed_gives_the_same_twin_and_run():
    draws = [draw_withheld(np.random.default_rng(s)) for s in (5, 5, 6)]
    assert draws[0] == draws[1] != draws[2]
    robot = twin(mujoco_drive(), draws[0])
    assert run(robot, 2.0, seed=3).equals(run(robot, 2.0, seed=3))
    assert not run(robot, 2.0, seed=3).equals(run(robot, 2.0, seed=4))


def test_the_truth_is_told_by_the_truth_alone():
    withheld = draw_withheld(np.random.default_rng(0))
    truth = json.loads(json.dumps(withheld.truth()))
    assert [e["effect"] for e in truth["effects"]] == ["wheel_radius_mismatch", "track_width", "actuator_lag"]
    assert truth["unknown"]
    robot = twin(mujoco_drive(), withheld)
    assert robot.name == "two_wheels"
    assert set(robot.channels) == set(mujoco_drive().channels)
    assert Withheld().truth()["effects"] == [] == Withheld().truth()["unknown"]
