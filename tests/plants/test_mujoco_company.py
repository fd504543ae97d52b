"""Grippers that nobody drives, objects, several bases, coupled joints, sensors and cameras do not refuse an arm."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np
import pytest
from oracles.arms import SERVOS, arm_xml, random_drive, random_start, robot_of
from oracles.urdfs import arm_urdf

from plants.mujoco_robot import MujocoRobot, build
from plants.mujoco_robot.model_structure import model_structure
from residual_mpc.errors import BadInput
from residual_mpc.logs.run import Run
from residual_mpc.models.facts import check_columns
from residual_mpc.models.robot_file import read_robot_file
from residual_mpc.models.settings import Settings

CUBE = '<body name="{name}" pos="{x} 1 0.1"><freejoint/><geom name="{name}" type="box" size="0.1 0.1 0.1"/></body>'
JAW = """<body name="jaw" pos="0.2 0 0"><joint name="jaw" axis="0 0 1" range="0 90"/>
<geom type="box" size="0.02 0.01 0.01" mass="0.05"/></body>"""
JAW_SERVO = '<position name="grip" joint="jaw" kp="5"/>'
EYES = """<sensor><jointpos joint="j1"/><actuatorfrc actuator="grip"/><force site="tool"/></sensor>
<keyframe><key qpos="0 0 0.5" ctrl="0 0 0.5"/></keyframe>"""
CHANNELS = ("position.j1", "position.j2", "velocity.j1", "velocity.j2")
ROVER = """<body name="{name}" pos="{x} 0 0.05"><freejoint/><geom type="box" size="0.1 0.08 0.02" mass="2" contype="0"
conaffinity="0"/><body pos="0 0.1 0"><joint name="{name}_left" axis="0 1 0"/><geom type="ellipsoid"
size="0.05 0.02 0.05" mass="0.1"/></body><body pos="0 -0.1 0"><joint name="{name}_right" axis="0 1 0"/>
<geom type="ellipsoid" size="0.05 0.02 0.05" mass="0.1"/></body>
<geom type="sphere" size="0.01" pos="-0.09 0 -0.04" mass="0.1" condim="1" priority="1"/>
<geom type="sphere" size="0.01" pos="0.09 0 -0.04" mass="0.1" condim="1" priority="1"/></body>"""


def moves_alike(one: MujocoRobot, other: MujocoRobot) -> None:
    drive, start = random_drive(other, 2, 200), random_start(other, 2)
    rest = {c: np.full(2, x) for c, x in one.rest.items()} | {f"velocity.{j}": np.zeros(2) for j in one.joints}
    mine = one.replay(rest | start, drive, Settings(2), CHANNELS)
    theirs = other.replay(start, drive, Settings(2), CHANNELS)
    for channel in CHANNELS:
        np.testing.assert_allclose(mine[channel], theirs[channel], atol=1e-12)


def folder(tmp_path: Path, name: str) -> Path:
    (tmp_path / name).mkdir()
    return tmp_path / name


def with_jaw() -> str:
    camera = '<camera name="eye"/><light name="lamp"/>'
    xml = arm_xml(SERVOS + JAW_SERVO).replace('<site name="middle"', f'{JAW}{camera}<site name="middle"')
    return xml.replace("</mujoco>", f"{EYES}</mujoco>")


def test_objects_are_there_and_the_arm_moves_as_without(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    objects = CUBE.format(name="cube", x=3) + CUBE.format(name="brick", x=5)
    xml = arm_xml().replace("<worldbody>", f"<worldbody>{objects}")
    with caplog.at_level(logging.WARNING):
        robot = robot_of(folder(tmp_path, "with"), xml)
    assert "free without a measured pose: cube, brick" in caplog.text
    assert robot.base is None and robot.joints == ("j1", "j2") and robot.lengths is not None
    moves_alike(robot, robot_of(folder(tmp_path, "without"), arm_xml()))
    structure = model_structure(tmp_path / "with" / "robot.xml")
    assert structure.base is None and structure.torque is not None


def test_one_of_several_rovers_is_named(tmp_path: Path) -> None:
    servos = "".join(f'<velocity name="{n}_{s}" joint="{n}_{s}" kv="2"/>' for n in "ab" for s in ("left", "right"))
    bodies = ROVER.format(name="a", x=0) + ROVER.format(name="b", x=2) + CUBE.format(name="cube", x=5)
    xml = (
        '<mujoco><option timestep="0.002" integrator="implicitfast"/><worldbody><geom type="plane" size="0 0 1"/>'
        f"{bodies}</worldbody><actuator>{servos}</actuator></mujoco>"
    )
    with pytest.raises(BadInput, match=r'body a and b have a free joint and motors.*pose_body = "a"'):
        robot_of(tmp_path, xml)
    with pytest.raises(BadInput, match=r"'chassis'; bodies with a free joint: a, b, cube"):
        robot_of(tmp_path, xml, pose_body="chassis")
    robot = robot_of(tmp_path, xml, pose_body="b")
    assert robot.base is not None and robot.model.body(robot.base.body).name == "b"
    assert model_structure(tmp_path / "robot.xml").base == "a"
    drive = random_drive(robot, 1, 400)
    drive.command[:] = (0.0, 0.0, 4.0, 4.0)  # b drives ahead
    start = {c: np.zeros(1) for s in robot.states for c in (s.position, s.velocity) if c}
    start["pose.x"] = np.full(1, 2.0)
    came = robot.replay(start, drive, Settings(1), ("pose.x", "position.a_left"))
    assert came["pose.x"][0, -1] - 2.0 == pytest.approx(0.8 * 4.0 * 0.05, abs=0.03)  # s, rad/s, m
    assert abs(came["position.a_left"][0, -1]) < 0.05


def test_two_arms_on_two_fixed_bases(tmp_path: Path) -> None:
    second = arm_xml().split("<worldbody>")[1].split("</worldbody>")[0]
    for name in ("upper", "lower", "j1", "j2", "middle", "tool"):
        second = second.replace(f'name="{name}"', f'name="right_{name}"')
    more = SERVOS + SERVOS.replace('"j', '"right_j')
    robot = robot_of(folder(tmp_path, "two"), arm_xml(more).replace("</worldbody>", f"{second}</worldbody>"))
    assert robot.joints == ("j1", "j2", "right_j1", "right_j2") and robot.base is None
    alone = robot_of(folder(tmp_path, "one"), arm_xml())
    drive, start = random_drive(robot, 1, 200), random_start(robot, 1)
    half = random_drive(robot, 1, 200)
    half = type(half)(half.dt, half.lead, drive.command[..., :2], None, half.clock)
    mine, theirs = (dict(r.replay(start, d, Settings(1), CHANNELS)) for r, d in ((robot, drive), (alone, half)))
    for channel in CHANNELS:
        np.testing.assert_allclose(mine[channel], theirs[channel], atol=1e-9)


@pytest.mark.parametrize("name", ["grip", "jaw"])
def test_a_gripper_that_nobody_commands_stays_where_it_is(tmp_path: Path, name: str) -> None:
    robot = robot_of(tmp_path, with_jaw(), held=(name,))
    assert robot.actuators == ("j1", "j2") and robot.held == ("grip",)
    start = {c: np.zeros(1) for s in robot.states for c in (s.position, s.velocity) if c}
    start["position.jaw"] = np.full(1, 0.7)
    came = robot.replay(start, random_drive(robot, 1, 1000), Settings(1), ("position.jaw", "position.j1"))
    np.testing.assert_allclose(came["position.jaw"], 0.7, atol=2e-3)
    assert np.ptp(came["position.j1"]) > 0.1
    t = np.arange(3.0)
    columns = dict.fromkeys(("command.j1", "command.j2", "position.j1"), t)
    check_columns([Run("one", t, columns)], [robot])
    with pytest.raises(BadInput, match=r"command\.grip .*still.*delete its line under \[log\].*emove it from `held`"):
        check_columns([Run("one", t, columns | {"command.grip": t})], [robot])
    with pytest.raises(BadInput, match=r'held = \["grip"\]'):
        check_columns([Run("one", t, columns)], [robot_of(tmp_path, with_jaw())])
    with pytest.raises(BadInput, match=r"held names 'jow'.*jaw"):
        robot_of(tmp_path, with_jaw(), held=("jow",))


def test_the_mimic_joints_of_a_urdf_follow(tmp_path: Path) -> None:
    finger = """<link name="{n}"><inertial><mass value="0.02"/><inertia ixx="1e-5" iyy="1e-5" izz="1e-5" ixy="0" ixz="0"
    iyz="0"/></inertial></link><joint name="{n}" type="prismatic"><parent link="lower"/><child link="{n}"/>
    <origin xyz="0.2 0 0"/><axis xyz="0 0 {z}"/>{mimic}
    <limit lower="0" upper="0.05" effort="9" velocity="1"/></joint>"""
    mimic = '<mimic joint="left" multiplier="0.5" offset="0.01"/>'
    fingers = finger.format(n="left", z=1, mimic="") + finger.format(n="right", z=-1, mimic=mimic)
    (tmp_path / "arm.urdf").write_text(arm_urdf(("j1", "j2"), -3, 3).replace("</robot>", f"{fingers}</robot>"))
    servo = '[actuator.{}]\nkind = "position"\nkp = 30\nkv = 2\n'
    toml = 'plant = "mujoco"\nmodel = "arm.urdf"\n' + "".join(servo.format(j) for j in ("j1", "j2", "left"))
    (tmp_path / "robot.toml").write_text(toml)
    robot = build(read_robot_file(tmp_path / "robot.toml"))
    assert robot.passive == ("right",)
    assert [j.follows for j in model_structure(tmp_path / "arm.urdf").joints] == [None, None, None, "left"]
    start = {c: np.full(1, 0.02) for s in robot.states for c in (s.position, s.velocity) if c}
    came = robot.replay(start, random_drive(robot, 1, 300, size=0.03), Settings(1), ("position.left", "position.right"))
    np.testing.assert_allclose(came["position.right"], 0.01 + 0.5 * came["position.left"], atol=1e-3)
    assert np.ptp(came["position.left"]) > 1e-3
