"""A URDF, which says nothing of its servos, with the actuators that the robot file declares."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from oracles.arms import arm_xml, random_drive, random_start
from oracles.urdfs import arm_urdf

from plants.mujoco_robot import MujocoRobot, build
from residual_mpc.errors import BadInput
from residual_mpc.models.load import load_robot
from residual_mpc.models.model_structure import read_model_structure
from residual_mpc.models.robot_file import for_run, read_robot_file
from residual_mpc.models.settings import Settings

URDF = arm_urdf(("j1", "j2"), -3, 3)
BODY = """<body name="{name}" pos="{at} 0 0"><inertial pos="0.1 0 0.02" mass="0.5" diaginertia="0.01 0.012 0.008"/>
  <joint name="{joint}" axis="0 1 0" range="-3 3" damping="0.1" frictionloss="0.02" armature="{rotor}"
  actuatorfrcrange="-50 50"/>
  {rest}</body>"""
LOWER = BODY.format(name="lower", at=0.3, joint="j2", rotor=0.03, rest="")
MJCF = f"""<mujoco><compiler angle="radian"/><option integrator="implicitfast"/>
<worldbody>{BODY.format(name="upper", at=0, joint="j1", rotor=0, rest=LOWER)}</worldbody>
<actuator><position name="j1" joint="j1" kp="30" kv="1.5" forcerange="-4 4"/>
<motor name="j2" joint="j2" gear="3"/></actuator>
</mujoco>"""
SERVOS = """[actuator.j1]
kind = "position"
kp = 30
kv = 1.5
limit = 4
[actuator.j2]
kind = "motor"
gear = 3
armature = 0.03
"""
TOOL = """<link name="tool0"/><joint name="mount" type="fixed"><parent link="lower"/><child link="tool0"/>
  <origin xyz="0.2 0 0.05"/></joint></robot>"""


def robot_from(folder: Path, model: str, suffix: str, tables: str = "") -> MujocoRobot:
    (folder / f"arm{suffix}").write_text(model)
    (folder / "robot.toml").write_text(f'name = "arm"\nplant = "mujoco"\nmodel = "arm{suffix}"\n{tables}')
    return build(read_robot_file(folder / "robot.toml"))


def test_it_moves_like_the_same_robot_in_mjcf(tmp_path: Path) -> None:
    urdf, mjcf = robot_from(tmp_path, URDF, ".urdf", SERVOS), robot_from(tmp_path, MJCF, ".xml")
    assert urdf.actuators == mjcf.actuators and urdf.command_kinds == mjcf.command_kinds
    drive, start = random_drive(mjcf, 3, 400), random_start(mjcf, 3)
    channels = ("position.j1", "position.j2")
    mine, theirs = (dict(r.replay(start, drive, Settings(3), channels)) for r in (urdf, mjcf))
    for channel in channels:
        np.testing.assert_allclose(mine[channel], theirs[channel], atol=1e-9)
        assert np.ptp(mine[channel]) > 0.1


@pytest.mark.parametrize(
    ("tables", "said"),
    [
        ("", "no actuator"),
        (SERVOS.replace("j2", "j3"), "does not match any joint"),
        (SERVOS.replace("position", "servo"), "one of position, velocity, motor"),
        (SERVOS.replace('"motor"', '"torque"'), 'write kind = "motor"'),
        (SERVOS + 'payload_site = "tool0"\n', "if this is the robot's key 'payload_site', move it above the first"),
        ('payload_site = "hand"\n' + SERVOS, "neither a site nor a body of the model"),
        (SERVOS.replace("kp = 30\n", ""), "needs kp > 0"),
        (SERVOS.replace("kp = 30", "kp = -30"), "kp must be a number >= 0, got -30"),
        (SERVOS.replace("kp = 30", 'kp = "stiff"'), "kp must be a number >= 0, got 'stiff'"),
        (SERVOS.replace("limit", "limits"), "id you mean 'limit'"),
        ('actuator = "j1"\n', "tables [actuator.<joint>]"),
        ("[actuator]\nj1 = 3\n", "must be a table, got 3"),
    ],
)
def test_what_is_declared_wrongly_is_refused(tmp_path: Path, tables: str, said: str) -> None:
    with pytest.raises(BadInput) as fault:
        robot_from(tmp_path, URDF, ".urdf", tables)
    assert said in f"{fault.value} {fault.value.remedy}"


def test_a_payload_sits_at_a_link_that_hangs_on_a_fixed_joint(tmp_path: Path) -> None:
    named = robot_from(tmp_path, URDF.replace("</robot>", TOOL), ".urdf", f'payload_site = "tool0"\n{SERVOS}')
    site = '<site name="tool0" pos="0.2 0 0.05"/></body>'
    mjcf = robot_from(tmp_path, MJCF.replace("</body>", site, 1), ".xml", 'payload_site = "tool0"\n')
    drive, start = random_drive(mjcf, 1, 300), random_start(mjcf, 1)
    payload = {name: np.full((1, 1), value) for name, value in (("mass", 0.3), ("x", 0.0), ("y", 0.0), ("z", 0.0))}
    heavy, channels = Settings(1, effects={"payload": payload}), ("position.j1", "position.j2")
    mine, theirs, light = (
        dict(r.replay(start, drive, s, channels)) for r, s in ((named, heavy), (mjcf, heavy), (mjcf, Settings(1)))
    )
    for channel in channels:
        np.testing.assert_allclose(mine[channel], theirs[channel], atol=1e-9)
        assert np.abs(light[channel] - theirs[channel]).max() > 1e-3


def test_a_model_with_actuators_of_its_own_keeps_them(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="has actuators of its own"):
        robot_from(tmp_path, arm_xml(), ".xml", SERVOS)


def test_a_variant_may_have_other_gains(tmp_path: Path) -> None:
    tables = f'{SERVOS}[[variant]]\nruns = "stiff_*"\n[variant.actuator.j1]\nkind = "position"\nkp = 90\n'
    robot_from(tmp_path, URDF, ".urdf", tables)
    file = read_robot_file(tmp_path / "robot.toml")
    stiff = for_run(file, "stiff_1").actuators
    assert (stiff["j1"].kp, stiff["j2"].kind) == (90.0, "motor")
    assert load_robot(for_run(file, "stiff_1")).actuators == ("j1", "j2")


@pytest.mark.parametrize("name", ["arm.urdf.xacro", "arm.xacro", "arm.urdf"])
def test_a_xacro_is_refused_with_the_command_that_expands_it(tmp_path: Path, name: str) -> None:
    text = URDF.replace("<robot name", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name')
    (tmp_path / name).write_text(text.replace("<link name", '<xacro:property name="size" value="1"/><link name', 1))
    for load in (read_model_structure, lambda path: load_robot(read_robot_file(path))):
        with pytest.raises(BadInput, match=rf"xacro file.*`xacro {name} > (expanded_)?arm\.urdf`"):
            load(tmp_path / name)


def test_an_expanded_xacro_is_a_urdf(tmp_path: Path) -> None:
    text = URDF.replace("<robot name", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name')
    (tmp_path / "arm.urdf").write_text(text.replace("<link", "<!-- made from <xacro:arm> --><link", 1))
    assert [j.name for j in read_model_structure(tmp_path / "arm.urdf").joints] == ["j1", "j2"]
