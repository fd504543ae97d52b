"""A diagnosis in the user's own URDF: what it says moves like the diagnosed robot, and the rest of the text stays."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from plants.mujoco_robot.exports.urdf_text import read_urdf_text
from residual_mpc.cli.main import main

URDF = """<?xml version="1.0"?>
<!-- the arm of the third bench -->
<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <link name="base"/>
  <link name='upper'>  <!-- weighed in May -->
    <inertial><origin xyz="0.1 0 0.02" rpy="0.3 -0.2 0.1"/><mass value="0.5"/>
      <inertia ixx="0.01" iyy="0.012" izz="0.008" ixy="0.001" ixz="0" iyz="-0.0005"/></inertial>
    <visual><geometry><mesh filename="package://arm/upper.dae"/></geometry></visual>
    <visual><geometry><mesh filename="meshes/upper.stl"/></geometry></visual>
  </link>
  <link name="bracket"><inertial><mass value="0.1"/>
    <inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="lower"><inertial><origin xyz="0.08 0 0"/><mass value="0.4"/>
    <inertia ixx="0.002" iyy="0.003" izz="0.003" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="flange"/>
  <joint name="j1" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" effort="50" velocity="9"/><dynamics damping="0.1" friction="0.02"/></joint>
  <joint name="fixed" type="fixed"><parent link="upper"/><child link="bracket"/>
    <origin xyz="0.25 0 0" rpy="0 0.5 0.2"/></joint>
  <joint name="j2" type="revolute"><parent link="bracket"/><child link="lower"/><origin xyz="0.05 0 0.01"/>
    <axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="50" velocity="9"/></joint>
  <joint name="tool" type="fixed"><parent link="lower"/><child link="flange"/><origin xyz="0.2 0 0"/></joint>
</robot>
"""
SERVOS = """[actuator.j1]
kind = "position"
kp = 30
kv = 1.5
[actuator.j2]
kind = "position"
kp = 20
kv = 1
gear = 2
"""
SAID = {
    ("coulomb_friction", "j1", "torque"): 0.3,
    ("viscous_friction", "j2", "coefficient"): 0.2,
    ("payload", None, "mass"): 0.25,
    ("link_mass", "upper", "mass"): 0.1,
    ("link_mass", "upper", "com"): 0.02,
    ("link_length", "upper", "offset"): 0.03,
    ("saturation", "j2", "limit"): 4.0,
    ("tunable", None, "joint.j1.damping"): 0.25,
}
UNSAID = {
    ("command_delay", None, "delay"): 0.04,
    ("armature", "j1", "inertia"): 0.02,
    ("backlash", "j2", "gap"): 0.03,
    ("tunable", None, "actuator.j1.kp"): 33.0,
}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "arm.urdf").write_text(URDF)
    text = (
        f'name = "arm"\nplant = "mujoco"\nmodel = "arm.urdf"\ntunable = ["joint.j1.damping", "actuator.*.kp"]\n{SERVOS}'
    )
    (tmp_path / "robot.toml").write_text(text)
    return tmp_path


def exported(folder: Path, values: dict[tuple[str, str | None, str], float], to: str = "urdf") -> dict[str, Any]:
    from residual_mpc.models.settings import TUNE

    rows = [
        {"effect": TUNE if e == "tunable" else e, "target": t, "parameter": p, "value": v}
        for (e, t, p), v in values.items()
    ]
    model = {"schema": "residual-mpc/model/1", "robot": "arm", "robot_file": "robot.toml", "values": rows}
    (folder / "model.json").write_text(json.dumps(model))
    with pytest.raises(SystemExit) as end:
        main(["export", str(folder / "model.json"), "--to", to, "--out", str(folder / "out" / "deep")])
    assert end.value.code == 0
    return json.loads((folder / "out" / "deep" / "export.json").read_text())


@pytest.mark.parametrize("key", list(SAID))
def test_each_thing_that_it_says_moves_like_the_diagnosed_robot(
    folder: Path, key: tuple[str, str | None, str], capsys: pytest.CaptureFixture[str]
) -> None:
    document = exported(folder, {key: SAID[key]})
    friction = key[0] == "coulomb_friction"  # MuJoCo's own is softer than the candidate's
    assert document["left_out"] == [] and bool(document["approximated"]) == friction
    for figure in ("largest", "from_all_effects"):
        assert document["largest_difference"][figure] < (5e-4 if friction else 1e-6)
    before = exported(folder, {})
    plain = (folder / "out" / "deep" / "arm.urdf").read_text()
    assert before["left_out"] == [] and plain.replace("../../meshes", "meshes") == URDF


def test_a_servo_that_damps_less_is_not_in_it(folder: Path) -> None:
    document = exported(folder, {("viscous_friction", "j1", "coefficient"): -0.3})
    assert any("lower the servos' damping" in note for note in document["approximated"])
    assert 'damping="0"' in (folder / "out" / "deep" / "arm.urdf").read_text()


def test_a_payload_beside_its_site_moves_like_the_diagnosed_robot(folder: Path) -> None:
    values = {("payload", None, k): v for k, v in {"mass": 0.25, "x": 0.05, "y": -0.02, "z": 0.04}.items()}
    document = exported(folder, values)
    assert document["left_out"] == [] and document["largest_difference"]["from_all_effects"] < 1e-6


def test_all_together_and_what_it_cannot_say(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    document = exported(folder, SAID | UNSAID)
    assert document["largest_difference"]["largest"] < 5e-4 < 1e-3 < document["largest_difference"]["from_all_effects"]
    err = capsys.readouterr().err
    for name in ("command_delay", "armature", "backlash", "actuator.j1.kp"):
        assert f"left out: {name}" in err
    text = (folder / "out" / "deep" / "arm.urdf").read_text()
    for kept in (
        "the arm of the third bench",
        "weighed in May",
        "package://arm/upper.dae",
        'xmlns:xacro="',
        '"../../meshes/',
    ):
        assert kept in text
    assert all(what in text for what in document["left_out"])
    model = mujoco.MjModel.from_xml_string(
        text.replace("package://arm/", "").replace("<visual>", "<!--").replace("</visual>", "-->")
    )
    assert model.dof_damping.tolist() == pytest.approx([0.25, 0.2])
    assert model.dof_frictionloss.tolist() == pytest.approx([0.32, 0.0])
    assert model.jnt_actfrcrange[1].tolist() == pytest.approx([-8.0, 8.0])
    assert model.body_mass.sum() == pytest.approx(0.5 + 0.1 + 0.4 + 0.25 + 0.1)


def test_an_mjcf_has_no_urdf(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from oracles.arms import arm_xml

    (tmp_path / "arm.xml").write_text(arm_xml())
    (tmp_path / "robot.toml").write_text('name = "arm"\nplant = "mujoco"\nmodel = "arm.xml"\n')
    model = {"schema": "residual-mpc/model/1", "robot": "arm", "robot_file": "robot.toml", "values": []}
    (tmp_path / "model.json").write_text(json.dumps(model))
    with pytest.raises(SystemExit) as end:
        main(["export", str(tmp_path / "model.json"), "--to", "urdf"])
    assert end.value.code == 2 and "arm.xml is an MJCF. Export to mjcf" in capsys.readouterr().err


def test_the_text_is_edited_in_place() -> None:
    text = read_urdf_text(
        b"""<robot a='1 > 0'><!-- <link name="x"/> --><link name = 'x' /><link name="y"></link></robot>"""
    )
    x, y = text.root.all("link")
    text.write(x, "inertial/mass", {"value": "2"})
    text.write(y, "visual", {"name": 'a"b'})
    assert text.result() == (
        """<robot a='1 > 0'><!-- <link name="x"/> --><link name = 'x'><inertial><mass value="2"/></inertial></link>"""
        """<link name="y"><visual name='a"b'/></link></robot>"""
    )
    assert np.array_equal([x.begin, y.begin], [42, 61])
