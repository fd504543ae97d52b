"""The speed limits of a URDF are read from the file, whatever else is in it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from oracles.arms import arm_xml, robot_of
from oracles.urdfs import arm_urdf

from plants.mujoco_robot import build
from plants.mujoco_robot.loading.speed_limits import speed_limits
from residual_mpc.experiment.drive_setup import setup_from_model
from residual_mpc.experiment.motions import Motion
from residual_mpc.experiment.separate import within_limits
from residual_mpc.models import optional
from residual_mpc.models.actuators import Actuator
from residual_mpc.models.robot_file import RobotFile

URDF = arm_urdf(("j1", "j2"), -3.0, 3.0)


def limits_of(folder: Path, text: str) -> dict[str, float]:
    (folder / "arm.urdf").write_text(text)
    return speed_limits(str(folder / "arm.urdf"))


@pytest.mark.parametrize(("said", "first"), [("2.5", {"j1": 2.5}), ("0", {}), ("fast", {}), ("inf", {}), ("-1", {})])
def test_a_limit_that_says_nothing_is_none(tmp_path: Path, said: str, first: dict[str, float]) -> None:
    assert limits_of(tmp_path, URDF.replace('velocity="9"', f'velocity="{said}"', 1)) == {**first, "j2": 9.0}


def test_an_mjcf_file_has_none(tmp_path: Path) -> None:
    assert limits_of(tmp_path, arm_xml()) == {} and not optional.speed_limits(robot_of(tmp_path, arm_xml()))


def test_a_file_that_only_mujoco_reads_is_used_without(tmp_path: Path) -> None:
    """A prefix that is not declared, as of a plug-in, is no well-formed XML."""
    (tmp_path / "arm.urdf").write_text(URDF.replace("</robot>", "<drake:ignored/></robot>"))
    servos = {j: Actuator("position", 80.0, 4.0) for j in ("j1", "j2")}
    robot = build(RobotFile("arm", "mujoco", model=tmp_path / "arm.urdf", actuators=servos))
    assert robot.joints == ("j1", "j2") and not optional.speed_limits(robot)


@pytest.mark.parametrize(("most", "shrinks"), [(9.0, False), (0.5, True)])
def test_a_motion_that_a_drive_makes_too_fast_is_made_smaller(tmp_path: Path, most: float, shrinks: bool) -> None:
    """The commands of velocity drives are not slowed; the predicted speed decides."""
    (tmp_path / "arm.urdf").write_text(URDF.replace('velocity="9"', f'velocity="{most}"'))
    drives = {j: Actuator("velocity", kv=20.0) for j in ("j1", "j2")}
    robot = build(RobotFile("arm", "mujoco", model=tmp_path / "arm.urdf", actuators=drives))
    setup = setup_from_model(robot, {"j1": (-1.0, 1.0), "j2": (-1.0, 1.0)})
    t = setup.period * np.arange(101)
    motion = Motion("swing", t, np.stack([0.9 * np.sin(6.0 * t), 0.0 * t], axis=1))
    planned = within_limits(robot, setup, motion, {})
    assert planned.within
    assert bool(np.abs(planned.motion.command).max() < 0.89) == shrinks
