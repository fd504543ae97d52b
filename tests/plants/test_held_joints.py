"""Fingers and other joints that nobody drives: where a payload that they hold is, and how the arm is drawn."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from oracles.arms import arm_xml, robot_of
from oracles.urdfs import arm_urdf

from plants.mujoco_robot import build
from plants.mujoco_robot.simulation.plant import joint_points
from residual_mpc.export import Build, augment
from residual_mpc.export.moving import moving_apart
from residual_mpc.models.actuators import Actuator
from residual_mpc.models.robot_file import RobotFile
from residual_mpc.models.settings import Knob

DT = 0.02
FINGERS = "".join(
    f'''<link name="{n}"><inertial><origin xyz="0 0.01 0.02"/><mass value="0.12"/>
<inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="{n}" type="prismatic"><parent link="hand"/><child link="{n}"/><origin xyz="0 {y} 0.03"/><axis xyz="0 1 0"/>
<limit lower="0" upper="0.03" effort="5" velocity="0.1"/>{mimic}</joint>'''
    for n, y, mimic in (("left", 0.02, ""), ("right", -0.02, '<mimic joint="left"/>'))
)
HAND = """<link name="hand"><inertial><mass value="0.3"/>
<inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="mount" type="fixed"><parent link="lower"/><child link="hand"/><origin xyz="0 0 0.1"/></joint>"""


@pytest.mark.parametrize("site", [None, "hand"])
def test_a_payload_in_a_gripper_whose_body_is_fused_away_stays_where_it_is(tmp_path: Path, site: str | None) -> None:
    """Without its joint, a finger of a URDF is one body with the link that holds the hand."""
    path = tmp_path / "arm.urdf"
    path.write_text(arm_urdf(("j1", "j2"), -3.0, 3.0).replace("</robot>", f"{HAND}{FINGERS}</robot>"))
    servos = {j: Actuator("position", 80.0, 4.0) for j in ("j1", "j2")}
    robot = build(RobotFile("arm", "mujoco", model=path, actuators=servos, held=("left",), payload_site=site))
    model = augment(robot, {Knob("payload", None, "mass"): 0.4}, None, Build(DT))
    assert model.stepped.commands == ("j1", "j2")
    assert "position.left" not in model.stepped.states
    assert moving_apart(model, np.random.default_rng(0)) < 2e-3


def test_a_drawn_arm_leaves_out_joints_that_nobody_measures(tmp_path: Path) -> None:
    """The anchors of the others, and the tool, in each frame; the held joint rests."""
    robot = robot_of(tmp_path, arm_xml(), held=("j2",))
    q = np.linspace(0.0, 0.5, 9)
    both = joint_points(robot, {"position.j1": q, "position.j2": np.zeros(9)}, 2)
    one = joint_points(robot, {"position.j1": q}, 2)
    assert both.shape == (5, 3, 3) and one.shape == (5, 2, 3)
    np.testing.assert_allclose(one, both[:, [0, 2]], atol=1e-12)
