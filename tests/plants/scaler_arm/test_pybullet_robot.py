"""PyBullet as the nominal model: it keeps the contract, and replays its own simulator's run."""

from __future__ import annotations

import numpy as np
import pytest

from plants.scaler_arm import pybullet_robot
from plants.scaler_arm.engines.pybullet_arm import PybulletArm
from plants.scaler_arm.kinematics.geometry import MOTORS
from plants.scaler_arm.kinematics.loop_closure import at_posture
from plants.scaler_arm.motions import CircleWithHeight, references
from plants.scaler_arm.pybullet_robot import build
from plants.simulator import Recording, record, replaying
from residual_mpc.models.contract import check_robot
from residual_mpc.models.protocol import Drive
from residual_mpc.models.robot_file import RobotFile
from residual_mpc.models.settings import Settings

ROBOT = build(RobotFile("scaler_arm", "scaler_arm_pybullet"))
WANTED = tuple(f"position.{m}" for m in MOTORS)


@pytest.mark.slow
def test_it_keeps_the_contract() -> None:
    check_robot(ROBOT, np.random.default_rng(0), size=0.3)


def test_it_replays_the_simulators_own_run_and_processes_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    q = references(CircleWithHeight(), np.arange(0.0, 1.01, 0.01))
    run = record(PybulletArm(), replaying(q, 0.01), Recording(1.0, 0.01, at_posture(q[0])), np.random.default_rng(0))
    start = {f"position.{m}": np.repeat(q[0, i], 2) for i, m in enumerate(MOTORS)}
    start |= {f"velocity.{m}": np.zeros(2) for m in MOTORS}
    drive = Drive(0.01, 0, np.repeat(q[None, :100], 2, axis=0), None, np.zeros(2))
    alone = ROBOT.replay(start, drive, Settings(2), WANTED)
    for channel in WANTED:
        np.testing.assert_allclose(alone[channel][1], run[channel].to_numpy(), rtol=0, atol=1e-12)
    monkeypatch.setattr(pybullet_robot, "WORTH_PROCESSES", 1)
    spread = ROBOT.replay(start, drive, Settings(2), WANTED)
    for channel in WANTED:
        np.testing.assert_array_equal(spread[channel], alone[channel])
