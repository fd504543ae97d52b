"""Models load without the files of their looks, and with actuators that act on no joint; nothing is made up."""

from __future__ import annotations

import logging
import os
from pathlib import Path

import mujoco
import numpy as np
import pytest
from oracles.arms import SERVOS, arm_xml, random_drive, random_start, robot_of
from oracles.urdfs import arm_urdf

from plants.mujoco_robot import MujocoRobot, build
from plants.mujoco_robot.loading.compile import compile_model
from plants.mujoco_robot.model_structure import model_structure
from residual_mpc.diagnosis.data.dataset import build_dataset
from residual_mpc.diagnosis.predict.replay import start_states
from residual_mpc.errors import BadInput
from residual_mpc.logs.run import Run
from residual_mpc.models.facts import check_columns
from residual_mpc.models.robot_file import RobotFile, read_robot_file
from residual_mpc.models.settings import Settings

ASSETS = """<compiler meshdir="assets" texturedir="assets"/><asset><mesh name="shell" file="shell.stl"/>
<mesh file="unused.obj"/><texture name="skin" type="2d" file="skin.png"/><material name="skin" texture="skin"/>
<hfield name="hills" file="hills.png" size="1 1 1 0.1"/></asset>"""
SHELL = '<geom name="shell" type="mesh" mesh="shell" material="skin" {mass}/>'
HILLS = '<geom type="hfield" hfield="hills" pos="0 0 -9"/>'
PAIR = '<contact><pair geom1="shell" geom2="box"/></contact>'
INERTIAL = '<inertial pos="0.1 0 0" mass="0.4" diaginertia="0.002 0.003 0.003"/>'
FINGERS = """<body name="hand" pos="0 0 2"><inertial pos="0 0 0" mass="0.1" diaginertia="1e-3 1e-3 1e-3"/>
<body name="left"><joint name="left" type="slide" axis="0 1 0" ref="0.02"/>
  <inertial pos="0 0 0" mass="0.02" diaginertia="1e-5 1e-5 1e-5"/></body>
<body name="right"><joint name="right" type="slide" axis="0 -1 0" ref="0.02"/>
  <inertial pos="0 0 0" mass="0.02" diaginertia="1e-5 1e-5 1e-5"/></body></body></worldbody>
<tendon><fixed name="grip"><joint joint="left" coef="0.5"/><joint joint="right" coef="0.5"/></fixed></tendon>
<equality><joint joint1="left" joint2="right"/></equality>"""
GRIPPER = """<general name="gripper" tendon="grip" ctrlrange="0 255" gainprm="0.0157" biastype="affine"
 biasprm="0 -100 -10"/>"""
KEY = '</actuator><keyframe><key name="home" qpos="0 0 0.04 0.04" ctrl="255 0 0"/></keyframe>'
CHANNELS = ("position.j1", "position.j2", "velocity.j1", "velocity.j2")


def looks(mass: str = 'mass="0"', inertial: str = INERTIAL) -> str:
    xml = arm_xml().replace("<worldbody>", f"{ASSETS}<worldbody>{HILLS}", 1)
    return xml.replace('<geom type="box"', inertial + SHELL.format(mass=mass) + '<geom name="box" type="box"')


def gripping(xml: str = "", keys: str = KEY) -> str:
    arm = (xml or arm_xml()).replace("</worldbody>", FINGERS)
    return arm.replace("<actuator>", f"<actuator>{GRIPPER}").replace("</actuator>", keys)


def moves_alike(one: MujocoRobot, other: MujocoRobot) -> None:
    drive, start = random_drive(other, 2, 200), random_start(other, 2)
    rest = {c: np.full(2, x) for c, x in one.rest.items()} | {f"velocity.{j}": np.zeros(2) for j in one.joints}
    mine = one.replay(rest | start, drive, Settings(2), CHANNELS)
    theirs = other.replay(start, drive, Settings(2), CHANNELS)
    for channel in CHANNELS:
        np.testing.assert_allclose(mine[channel], theirs[channel], atol=1e-12)


def test_shapes_whose_files_are_absent_are_left_out(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        robot = robot_of(tmp_path, looks().replace("<actuator>", f"{PAIR}<actuator>"))
    (line,) = caplog.messages
    assert "hills.png, shell.stl, skin.png, unused.obj" in line and "2 shapes" in line and "\n" not in line
    assert (robot.model.nmesh, robot.model.ntex, robot.model.nhfield, robot.model.npair) == (0, 0, 0, 0)
    bare = tmp_path / "bare"
    bare.mkdir()
    moves_alike(robot, robot_of(bare, arm_xml().replace('<geom type="box"', f'{INERTIAL}<geom type="box"')))


def test_files_that_are_there_stay(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "assets").mkdir()
    corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    (tmp_path / "assets" / "shell.obj").write_text(corners)
    xml = looks().replace("shell.stl", "shell.obj").replace('file="unused.obj"', 'name="unused" file="shell.obj"')
    robot = robot_of(tmp_path, xml)
    assert robot.model.nmesh == 2 and robot.model.ntex == 0 and "shell" not in caplog.text


@pytest.mark.parametrize(
    ("mass", "inertial", "compiler"),
    [("", "", ""), ('mass="0.2"', "", ""), ("", INERTIAL, '<compiler inertiafromgeom="true"/>')],
)
def test_a_body_that_takes_its_mass_from_an_absent_file_is_refused(
    tmp_path: Path, mass: str, inertial: str, compiler: str
) -> None:
    xml = looks(mass, inertial).replace("<asset>", f"{compiler}<asset>")
    with pytest.raises(BadInput, match=r"robot\.xml: body 'lower' takes its mass from shell\.stl.*<inertial>"):
        robot_of(tmp_path, xml)


@pytest.mark.parametrize("place", [None, "ros/arm/meshes/shell.obj", "ros/arm/urdf/arm/meshes/shell.obj"])
def test_a_urdf_finds_its_package_or_does_without(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, place: str | None
) -> None:
    mesh = '<geometry><mesh filename="package://arm/meshes/shell.obj"/></geometry>'
    shell = f"</inertial><collision>{mesh}</collision></link>"
    urdf = arm_urdf(("j1", "j2"), -3, 3).replace("</inertial></link>", shell)
    folder = tmp_path / "ros" / "arm" / "urdf"
    folder.mkdir(parents=True)
    if place:
        (tmp_path / place).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / place).write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    (folder / "arm.urdf").write_text(urdf)
    servo = '[actuator.{}]\nkind = "position"\nkp = 30\n'
    toml = 'plant = "mujoco"\nmodel = "arm.urdf"\n' + servo.format("j1") + servo.format("j2")
    (folder / "robot.toml").write_text(toml)
    robot = build(read_robot_file(folder / "robot.toml"))
    assert bool(robot.model.nmesh) == bool(place)
    assert ("shell.obj" in caplog.text) == (not place)


CORNERS = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
MANIFEST = "<package format='3'><name>arm_description</name></package>"


@pytest.mark.parametrize(
    ("variable", "package", "entry"),
    [
        ("", "work/arm_repository", ""),  # above the model, under another name than its folder's
        ("AMENT_PREFIX_PATH", "install/arm/share/arm_description", "install/arm"),
        ("ROS_PACKAGE_PATH", "ros/src/vendor/arm_repository", "ros/src"),
        ("ROS_PACKAGE_PATH", "ros/src/arm_repository", "ros/src/arm_repository"),
    ],
)
def test_a_package_is_found_by_its_manifest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, variable: str, package: str, entry: str
) -> None:
    home, folder = tmp_path / "work" / "arm_repository" / "urdf", tmp_path / package
    for place in (home, folder / "meshes"):
        place.mkdir(parents=True, exist_ok=True)
    (folder / "package.xml").write_text(MANIFEST)
    (folder / "meshes" / "shell.obj").write_text(CORNERS)
    for name in ("AMENT_PREFIX_PATH", "ROS_PACKAGE_PATH"):
        monkeypatch.delenv(name, raising=False)
    mesh = '<geometry><mesh filename="package://arm_description/meshes/shell.obj"/></geometry>'
    urdf = arm_urdf(("j1", "j2"), -3, 3).replace(
        "</inertial></link>", f"</inertial><collision>{mesh}</collision></link>"
    )
    (home / "arm.urdf").write_text(urdf)
    if variable:
        assert compile_model(str(home / "arm.urdf"))[1].nmesh == 0
        monkeypatch.setenv(variable, f"/nowhere{os.pathsep}{tmp_path / entry}")
    assert compile_model(str(home / "arm.urdf"))[1].nmesh == 1


def test_what_is_absent_is_said_once(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "robot.xml").write_text(looks())
    for path in (tmp_path / "robot.xml", tmp_path / "." / "robot.xml", Path(os.path.relpath(tmp_path / "robot.xml"))):
        compile_model(str(path))
    assert len(caplog.messages) == 1


def test_a_gripper_on_a_tendon_is_held(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    robot = robot_of(tmp_path, gripping())
    assert robot.actuators == ("j1", "j2") and robot.held == ("gripper",)
    assert "'gripper'" in caplog.text and "held" in caplog.text
    assert model_structure(tmp_path / "robot.xml").actuators[0].name == "j1"
    plain = tmp_path / "plain"
    plain.mkdir()
    moves_alike(robot, robot_of(plain, arm_xml()))
    drive = random_drive(robot, 1, 400)
    start = {c: np.full(1, x) for c, x in robot.rest.items()} | {f"velocity.{j}": np.zeros(1) for j in robot.joints}
    came = robot.replay(start, drive, Settings(1), ("position.left", "position.right"))
    for finger in came.values():  # they stay where they are, as the servo would hold them
        np.testing.assert_allclose(finger, 0.02, atol=1e-6)


def test_the_held_servo_is_the_springs_that_it_was(tmp_path: Path) -> None:
    """As mj_step has it with the actuator, held where the fingers rest."""
    robot = robot_of(tmp_path, gripping())
    model = mujoco.MjModel.from_xml_string(gripping())
    data = mujoco.MjData(model)
    data.qpos[2:] = 0.03
    data.ctrl[0] = 100 * 0.02 / 0.0157
    start = {c: np.full(1, x) for c, x in robot.rest.items()} | {f"velocity.{j}": np.zeros(1) for j in robot.joints}
    start["position.left"] = np.full(1, 0.03)
    steps = 50
    came = robot.replay(start, random_drive(robot, 1, steps, size=0.0), Settings(1), ("position.left",))
    literal = [data.qpos[2]]
    for _ in range(steps):
        mujoco.mj_step(model, data)
        literal.append(data.qpos[2])
    np.testing.assert_allclose(came["position.left"][0], literal, atol=2e-5)
    assert abs(literal[-1] - 0.03) > 1e-3


def test_joints_that_nobody_measures_start_where_the_model_rests(tmp_path: Path) -> None:
    robot = robot_of(tmp_path, gripping())
    t = np.arange(0.0, 4.0, 0.01)
    columns = {f"{kind}.{j}": 0.3 * np.sin(3.0 * t) for kind in ("command", "position") for j in ("j1", "j2")}
    data = build_dataset([Run("one", t, columns)], [robot], {}, 1.0)
    start = start_states(data, data.blocks[0], Settings(1))
    assert robot.passive == ("right",) and (start["position.left"] == 0.02).all()


def test_a_log_that_commands_a_held_actuator_is_refused(tmp_path: Path) -> None:
    robot = robot_of(tmp_path, gripping())
    t = np.arange(3.0)
    columns = dict.fromkeys(("command.j1", "command.j2", "position.j1"), t)
    check_columns([Run("one", t, columns)], [robot])
    with pytest.raises(BadInput, match=r"command\.gripper.*held still.*joint="):
        check_columns([Run("one", t, columns | {"command.gripper": t})], [robot])


def test_an_actuator_that_cannot_be_held_is_refused(tmp_path: Path) -> None:
    pull = '<general name="pull" site="tool" refsite="middle" biastype="affine" biasprm="0 -5 0"/>'
    with pytest.raises(BadInput, match="'pull' does not act on a joint"):
        robot_of(tmp_path, arm_xml(SERVOS + pull))


def test_a_robot_of_nothing_but_tendons_has_no_actuator(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="no actuator on a joint"):
        build(RobotFile("robot", "mujoco", model=_written(tmp_path, gripping(arm_xml(""), "</actuator>"))))


def _written(folder: Path, xml: str) -> Path:
    path = folder / "robot.xml"
    path.write_text(xml)
    return path
