"""A link's length against models that MuJoCo itself compiles with the next joint elsewhere."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from oracles.arms import CHANNELS, arm_xml, literal, random_drive, random_start, robot_of, settings_of

OFFSET = 0.043  # m
# the lower link on a bracket that is welded to the upper one and stands askew
BRACKET = arm_xml().replace(
    '<body name="lower" pos="0.3 0 0.05">',
    '<body name="bracket" pos="0.3 0 0.05" euler="20 -40 70"><geom size="0.02" mass="0.1"/><body name="lower">',
).replace("      </body>\n    </body>\n", "      </body></body>\n    </body>\n")  # fmt: skip


def farther(xml: str, body: str, anchor: np.ndarray) -> mujoco.MjModel:
    """The model compiled with `body` moved by OFFSET along `anchor`, in its parent's frame."""
    spec = mujoco.MjSpec.from_string(xml)
    spec.body(body).pos = spec.body(body).pos + OFFSET * anchor / np.linalg.norm(anchor)
    return spec.compile()


@pytest.mark.parametrize("xml", [arm_xml(), BRACKET])
def test_a_longer_link_is_the_model_compiled_with_it(tmp_path: Path, xml: str) -> None:
    robot = robot_of(tmp_path, xml)
    assert robot.slots("link_length") == ("upper",)
    line = np.array([0.3, 0.0, 0.05])
    if xml is BRACKET:
        turn = np.zeros(9)
        mujoco.mju_quat2Mat(turn, robot.model.body("bracket").quat)
        line = turn.reshape(3, 3).T @ line
    model = farther(xml, "lower", line)
    drive, start = random_drive(robot, 2, 200), random_start(robot, 2)
    hypotheses = ({("link_length", "upper", "offset"): OFFSET}, {})
    came = robot.replay(start, drive, settings_of(robot, *hypotheses), CHANNELS)
    for row, truth in enumerate((model, robot.model)):
        q, v, _ = literal(truth, start, drive.command[row, drive.lead :], row)
        for j, joint in enumerate(("j1", "j2")):
            np.testing.assert_allclose(came[f"position.{joint}"][row], q[:, j], rtol=0, atol=1e-11)
            np.testing.assert_allclose(came[f"velocity.{joint}"][row], v[:, j], rtol=0, atol=1e-9)
    plain = literal(robot.model, start, drive.command[0, drive.lead :], 0)[0]
    assert np.abs(came["position.j1"][0] - plain[:, 0]).max() > 1e-3


def test_it_joins_a_payload_and_a_centre_of_mass(tmp_path: Path) -> None:
    robot = robot_of(tmp_path, arm_xml())
    both = {
        ("link_length", "upper", "offset"): OFFSET,
        ("payload", None, "mass"): 0.3,
        ("link_mass", "upper", "com"): 0.02,
    }
    spec = mujoco.MjSpec.from_string(arm_xml())
    line = np.array([0.3, 0.0, 0.05])
    spec.body("lower").pos = spec.body("lower").pos + OFFSET * line / np.linalg.norm(line)
    ball = {"type": mujoco.mjtGeom.mjGEOM_SPHERE, "size": [1e-4, 0, 0], "pos": [0.2, 0.01, -0.02], "mass": 0.3}
    spec.body("lower").add_geom(**ball, contype=0, conaffinity=0)
    model = spec.compile()
    model.body_ipos[model.body("upper").id] += 0.02 * line / np.linalg.norm(line)
    mujoco.mj_setConst(model, mujoco.MjData(model))
    drive, start = random_drive(robot, 1, 200), random_start(robot, 1)
    came = robot.replay(start, drive, settings_of(robot, both), CHANNELS)
    q, _, _ = literal(model, start, drive.command[0, drive.lead :], 0)
    np.testing.assert_allclose(came["position.j1"][0], q[:, 0], rtol=0, atol=3e-7)


def test_a_link_may_not_shrink_to_nothing_or_fork(tmp_path: Path) -> None:
    robot = robot_of(tmp_path, arm_xml())
    low, high = robot.bounds("link_length", "offset", "upper")
    assert low == pytest.approx(-0.9 * np.hypot(0.3, 0.05)) and high > 0.3
    finger = '<body name="finger" pos="0.2 0 0"><joint name="j3"/><geom size="0.02" mass="0.05"/></body>'
    forked = arm_xml().replace('<body name="lower"', f'{finger}<body name="lower"')
    assert robot_of(tmp_path, forked).slots("link_length") == ()
