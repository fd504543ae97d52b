"""PyBullet as the nominal model: the contract of a robot, and the same figures in one process and in two."""

import numpy as np
import pytest

from plants.simulator import running
from plants.wheeled import bullet_drive
from plants.wheeled import pybullet_robot as module
from plants.wheeled.pybullet_robot import BulletRobot
from plants.wheeled.robots import geometry_of
from residual_mpc.effects.library import LIBRARY
from residual_mpc.errors import BadInput
from residual_mpc.models.contract import check_robot
from residual_mpc.models.protocol import Drive
from residual_mpc.models.robot_file import RobotFile
from residual_mpc.models.settings import Knob, Settings, assemble

ROBOT = BulletRobot("two")
POSE = ("pose.x", "pose.y", "pose.theta")


def starts(rows: int) -> dict[str, np.ndarray]:
    return {c: np.linspace(-0.1, 0.2, rows) for c in ROBOT.channels}


def test_a_replay_is_the_simulator():
    """From rest, the same commands: the model is the simulator at a coarser step."""
    drive = Drive(0.01, 0, np.tile([4.0, 6.0], (1, 100, 1)), None, np.zeros(1))
    out = ROBOT.replay({c: np.zeros(1) for c in ROBOT.channels}, drive, Settings(1), POSE)
    with running(bullet_drive(), np.random.default_rng(0), {}) as plant:
        plant.step(np.array([4.0, 6.0]), 1.0)
        end = plant.truth()
    np.testing.assert_allclose([out[c][0, -1] for c in POSE], [end[c] for c in POSE], atol=1.5e-3)


def test_each_row_has_its_own_geometry():
    hypotheses = [{}, {Knob("track_width", None, "scale"): 1.2}, {Knob("wheel_radius", None, "scale"): 0.9}]
    settings = assemble(hypotheses, {e.name: ROBOT.slots(e.name) for e in LIBRARY})
    drive = Drive(0.01, 0, np.tile([-3.0, 3.0], (3, 60, 1)), None, np.zeros(3))
    theta = ROBOT.replay({c: np.zeros(3) for c in ROBOT.channels}, drive, settings, POSE)["pose.theta"][:, -1]
    np.testing.assert_allclose(theta / theta[0], [1.0, 1 / 1.2, 0.9], rtol=0.01)


def test_parameters_of_a_robot_file():
    geometry = geometry_of(RobotFile("two", "diff_drive_pybullet", parameters={"track_width": 0.3}))
    assert (geometry.track, geometry.left.radius) == (0.3, 0.033)
    with pytest.raises(BadInput, match="unknown parameter 'track'"):
        geometry_of(RobotFile("two", "diff_drive_pybullet", parameters={"track": 0.3}))


@pytest.mark.slow
def test_it_keeps_the_contract_of_a_robot():
    check_robot(ROBOT, np.random.default_rng(0), size=3.0)


@pytest.mark.slow
def test_two_processes_say_the_same_as_one(monkeypatch):
    drive = Drive(0.01, 0, np.random.default_rng(0).uniform(-5, 5, (6, 30, 2)), None, np.zeros(6))
    scales = [{Knob("track_width", None, "scale"): s} for s in (1.0, 1.2, 1.0, 1.1, 1.2, 1.1)]
    settings = assemble(scales, {e.name: ROBOT.slots(e.name) for e in LIBRARY})
    alone = ROBOT.replay(starts(6), drive, settings, ROBOT.channels)
    monkeypatch.setattr(module, "WORTH", 0)
    monkeypatch.setattr(module, "_processes", lambda: 2)
    shared = ROBOT.replay(starts(6), drive, settings, ROBOT.channels)
    for channel in ROBOT.channels:
        np.testing.assert_allclose(shared[channel], alone[channel], rtol=1e-9, atol=1e-12)
