"""Models that are not supported are refused with one clear message; names are found where none are given."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from oracles.arms import MIXED, SERVOS, arm_xml, random_drive, robot_of

from plants.mujoco_robot import build
from plants.mujoco_robot.model_structure import model_structure
from residual_mpc.errors import BadInput
from residual_mpc.models.robot_file import RobotFile
from residual_mpc.models.settings import Settings

FREE = '<body><freejoint name="base"/><geom size="0.1"/></body>'
BALL = '<body pos="1 1 1"><joint name="socket" type="ball"/><geom size="0.1"/></body>'
CRANK = """<body name="crank" pos="1 1 1"><joint name="crank" axis="0 1 0"/><geom size="0.05"/>
  <body name="rod" pos="0.2 0 0"><joint name="rod" axis="0 1 0"/><geom size="0.05"/></body></body>"""
LOOSE = '<equality><joint joint1="crank" joint2="rod"/></equality>'
AT_ROD = '<site name="at_rod"/></body></body>'
OPEN = '<site name="far" pos="9 9 9"/>'
APART = '<equality><connect site1="at_rod" site2="far"/></equality>'
SITE = '<motor name="thrust" site="tool"/>'


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("<worldbody>", f"<worldbody>{BALL}", "'socket' is a ball joint"),
        (f"<actuator>{SERVOS}</actuator>", "", "no actuator"),
        ('<joint name="j2"', '<joint nam="j2"', "does not compile"),
        ("</mujoco>", "", "does not compile"),
        ("mass=", "mas=", "does not compile"),
        ('<joint name="j2"', "<joint", "does not compile"),  # an actuator names it
        ('<position name="j2"', "<position", "actuator number 1 has no name"),
        (
            "</worldbody>",
            f"{CRANK.replace('</body></body>', AT_ROD)}{OPEN}</worldbody>{APART}",
            "closed loops have gaps",
        ),
    ],
)
def test_what_is_not_supported_is_refused(tmp_path: Path, old: str, new: str, said: str) -> None:
    xml = arm_xml()
    assert old in xml
    with pytest.raises(BadInput) as fault:
        robot_of(tmp_path, xml.replace(old, new, 1))
    assert said in str(fault.value) and "robot.xml" in str(fault.value)
    assert "\n" not in str(fault.value)


def test_joints_that_no_loop_determines_move_freely(tmp_path: Path) -> None:
    robot = robot_of(tmp_path, arm_xml().replace("</worldbody>", f"{CRANK}</worldbody>{LOOSE}"))
    assert robot.passive == ("rod",) and robot.rest["position.crank"] == 0.0
    start = {c: np.full(1, 0.1) for s in robot.states for c in (s.position, s.velocity) if c}
    came = robot.replay(start, random_drive(robot, 1, 100), Settings(1), ("position.crank", "position.rod"))
    assert came["position.rod"][0, 0] == pytest.approx(0.1)  # as the equality has it
    assert np.ptp(came["position.crank"]) > 0.01  # it falls
    np.testing.assert_allclose(came["position.rod"], came["position.crank"], atol=5e-3)


def test_a_motor_on_a_site_gives_nothing_while_nobody_commands_it(tmp_path: Path) -> None:
    robot = robot_of(tmp_path, arm_xml().replace("<actuator>", f"<actuator>{SITE}"))
    assert robot.actuators == ("j1", "j2") and robot.held == ("thrust",)


def test_numbers_beside_the_models_own_are_refused(tmp_path: Path) -> None:
    (tmp_path / "robot.xml").write_text(arm_xml())
    with pytest.raises(BadInput, match=r"does not read.*joint\.j1\.damping.*tunable"):
        build(RobotFile("arm", "mujoco", model=tmp_path / "robot.xml", parameters={"joint.j1.damping": 0.5}))


def test_a_joint_without_a_name_is_refused(tmp_path: Path) -> None:
    extra = '<body pos="1 1 1"><joint axis="0 0 1"/><geom size="0.1"/></body>'
    with pytest.raises(BadInput, match="joint number 0 has no name"):
        robot_of(tmp_path, arm_xml().replace("<worldbody>", f"<worldbody>{extra}"))


@pytest.mark.parametrize(
    ("xml", "said"),
    [
        ("<mujoco><worldbody/></mujoco>", "no hinge or slide joint"),
        (
            arm_xml('<motor name="rocket" joint="base"/>').replace("<worldbody>", f"<worldbody>{FREE}"),
            "'rocket' acts on a free joint",
        ),
    ],
)
def test_what_no_robot_file_could_drive_has_no_anatomy(tmp_path: Path, xml: str, said: str) -> None:
    (tmp_path / "robot.xml").write_text(xml)
    with pytest.raises(BadInput, match=said):
        model_structure(tmp_path / "robot.xml")


def test_a_payload_site_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="The model has: middle, tool, upper, lower"):
        robot_of(tmp_path, arm_xml(), payload_site="flange")


def test_a_robot_without_a_model_is_refused() -> None:
    from plants.mujoco_robot import build

    with pytest.raises(BadInput, match="key 'model' is missing"):
        build(RobotFile("robot", "mujoco"))


def test_what_the_robot_is_called(tmp_path: Path) -> None:
    robot = robot_of(tmp_path, arm_xml(MIXED))
    assert robot.actuators == ("j1", "j2") == robot.joints and robot.links == ("upper", "lower")
    assert robot.command_kinds == ("torque", "velocity") and robot.step == 0.002
    assert robot_of(tmp_path, arm_xml()).command_kinds == ("position", "position")
    body, at = robot.payload
    assert robot.model.body(body).name == "lower"
    np.testing.assert_allclose(at, [0.2, 0.01, -0.02])  # the last body's last site
    bare = robot_of(tmp_path, re.sub("<site.*/>", "", arm_xml()))
    np.testing.assert_allclose(bare.payload[1], bare.model.body_ipos[2])  # else the centre of mass


def test_a_urdf_compiles_but_has_no_actuator(tmp_path: Path) -> None:
    urdf = """<robot name="r"><link name="base"/><link name="tip"><inertial><mass value="1"/>
      <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
      <joint name="j" type="continuous"><parent link="base"/><child link="tip"/>
      <axis xyz="0 0 1"/></joint></robot>"""
    path = tmp_path / "r.urdf"
    path.write_text(urdf)
    from plants.mujoco_robot import build

    with pytest.raises(BadInput, match="no actuator"):
        build(RobotFile("robot", "mujoco", model=path))


def test_mujoco_is_imported_when_a_robot_is_built() -> None:
    program = "import sys, plants.mujoco_robot; assert 'mujoco' not in sys.modules"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
