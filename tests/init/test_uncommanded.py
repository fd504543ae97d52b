"""Joints that no column commands are held where they stand still, and reported where they move."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from init.arm_logs import URDF, mjcf, simulate, write

from residual_mpc.cli.main import main
from residual_mpc.init.draft import Draft, draft
from residual_mpc.init.draft_text import robot_file_text
from residual_mpc.models.load import load_robot
from residual_mpc.models.robot_file import read_robot_file

JAW = """<body name="{n}" pos="0.2 0 0"><inertial pos="0 0 0" mass="0.05" diaginertia="1e-4 1e-4 1e-4"/>
<joint name="{n}" axis="0 0 1" range="0 1.5"/></body>"""
SERVO = '<position name="{n}" joint="{n}" kp="5"/>'
FINGER = """<link name="{n}"><inertial><mass value="0.02"/><inertia ixx="1e-5" iyy="1e-5" izz="1e-5" ixy="0" ixz="0"
iyz="0"/></inertial></link><joint name="{n}" type="prismatic"><parent link="lower"/><child link="{n}"/>
<axis xyz="0 1 0"/>{mimic}<limit lower="0" upper="0.05" effort="9" velocity="1"/></joint>"""


@pytest.fixture(scope="module")
def recorded() -> pd.DataFrame:
    return simulate(seconds=10.0)


def gripping_arm() -> str:
    xml = mjcf().replace('<site name="tool"', f'{JAW.format(n="jaw")}<site name="tool"')
    return xml.replace("</actuator>", f"{SERVO.format(n='jaw')}</actuator>")


def drafted(folder: Path, name: str, text: str, table: pd.DataFrame) -> Draft:
    (folder / name).write_text(text)
    return draft(folder / name, [write(folder, table)])


@pytest.mark.parametrize("jaw", [None, 0.7])
def test_a_gripper_without_a_command_is_held(tmp_path: Path, recorded: pd.DataFrame, jaw: float | None) -> None:
    table = recorded
    if jaw is not None:
        table = recorded.assign(
            **{"position.jaw": jaw + 1e-3 * np.random.default_rng(0).standard_normal(len(recorded))}
        )
    found = drafted(tmp_path, "arm.xml", gripping_arm(), table)
    assert found.held == ("jaw",)
    (tmp_path / "robot.toml").write_text(robot_file_text(found, tmp_path))
    assert load_robot(read_robot_file(tmp_path / "robot.toml")).actuators == ("shoulder", "elbow")


def test_a_gripper_that_moves_without_a_command_is_missed(tmp_path: Path, recorded: pd.DataFrame) -> None:
    table = recorded.assign(**{"position.jaw": 0.7 + 0.5 * np.sin(recorded["t"])})
    found = drafted(tmp_path, "arm.xml", gripping_arm(), table)
    assert found.held == () and "command.jaw" in {m.name for m in found.missing}


def test_the_fingers_of_a_urdf_are_held_and_their_mimics_follow(tmp_path: Path, recorded: pd.DataFrame) -> None:
    fingers = FINGER.format(n="left", mimic="") + FINGER.format(n="right", mimic='<mimic joint="left"/>')
    found = drafted(tmp_path, "arm.urdf", URDF.replace("</robot>", f"{fingers}</robot>"), recorded)
    assert found.held == ("left",) and not {m.name for m in found.missing} & {"command.right", "position.right"}
    (tmp_path / "robot.toml").write_text(robot_file_text(found, tmp_path))
    robot = load_robot(read_robot_file(tmp_path / "robot.toml"))
    assert robot.actuators == ("shoulder", "elbow")


def test_wheels_are_never_held(tmp_path: Path, recorded: pd.DataFrame) -> None:
    table = recorded.drop(columns=[c for c in recorded if c.endswith("elbow")])
    xml = mjcf("velocity")
    found = drafted(tmp_path, "arm.xml", xml, table)
    assert found.held == () and "command.elbow" in {m.name for m in found.missing}


def test_a_held_gripper_needs_no_edit_up_to_the_gap(
    tmp_path: Path, recorded: pd.DataFrame, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "arm.xml").write_text(gripping_arm())
    log, robot = write(tmp_path, recorded), tmp_path / "robot.toml"
    for words in (
        ["init", str(tmp_path / "arm.xml"), str(log), "--out", str(robot)],
        ["gap", "--robot", str(robot), str(log)],
    ):
        with pytest.raises(SystemExit) as end:
            main(words)
        assert end.value.code == 0, capsys.readouterr().err
    assert "noise floor" in capsys.readouterr().out
