"""On which joints pairs of effects are looked for, and which effects stand in for each other there."""

from __future__ import annotations

from pathlib import Path

import pytest
from oracles.arms import MIXED, SERVOS, arm_xml, robot_of, wheel_xml

from residual_mpc.diagnosis.search.pairs import _only_driven
from residual_mpc.diagnosis.search.substitutes import imitate
from residual_mpc.models.settings import Term

FURUTA = '<motor name="arm" joint="j1"/>'  # the second joint is a free pendulum


@pytest.mark.parametrize(
    ("xml", "expected"), [(arm_xml(FURUTA), "j1"), (arm_xml(SERVOS), None), (arm_xml(MIXED), None), (wheel_xml(), None)]
)
def test_the_only_joint_with_a_motor(tmp_path: Path, xml: str, expected: str | None) -> None:
    assert _only_driven(robot_of(tmp_path, xml)) == expected


@pytest.mark.parametrize(("joint", "expected"), [("j1", True), ("j2", False)])
def test_an_encoder_is_compared_with_what_acts_at_its_joint(joint: str, expected: bool) -> None:
    bias, offset = Term("sensor_bias", "position.j1"), Term("torque_offset", joint)
    assert imitate(bias, offset) == imitate(offset, bias) == expected
