"""The unit of a number of an effect, on this robot."""

from __future__ import annotations

from pathlib import Path

import pytest
from diagnosis.linear import ROVER
from oracles.arms import robot_of

from residual_mpc.effects.library import BY_NAME
from residual_mpc.models.parameter_units import command_units, unit_of
from residual_mpc.models.settings import Term

GANTRY = """<mujoco><worldbody><body><joint name="lift" type="slide" axis="0 0 1"/><geom size="0.1" mass="1"/>
<body pos="0 0 0.2">{}<geom size="0.1" mass="1"/></body></body></worldbody>
<actuator><position name="hoist" joint="lift" kp="500"/>
<velocity name="spin" joint="turn" kv="5"/></actuator></mujoco>"""
MIXED = GANTRY.format('<joint name="turn" type="hinge"/>')
SLIDES = GANTRY.format('<joint name="turn" type="slide"/>')


@pytest.mark.parametrize(
    ("motor", "unit"),
    [
        ('gear="24" ctrlrange="-1 1"', "1"),
        ('gear="24" ctrlrange="0 1"', "1"),
        ('gear="24" ctrlrange="-2 2"', "N m"),
        ('gear="24"', "N m"),
        ('ctrlrange="-1 1"', "N m"),
    ],
)
def test_a_share_of_a_motors_torque_has_no_unit(motor: str, unit: str, tmp_path: Path) -> None:
    xml = MIXED.replace('<velocity name="spin" joint="turn" kv="5"/>', f'<motor name="spin" joint="turn" {motor}/>')
    assert command_units(robot_of(tmp_path, xml)) == ("m", unit)


@pytest.mark.parametrize(
    ("effect", "target", "unit"),
    [
        ("coulomb_friction", "lift", "N"),
        ("viscous_friction", "lift", "N s/m"),
        ("armature", "lift", "kg"),
        ("saturation", "hoist", "N"),
        ("dead_zone", "hoist", "m"),
        ("rate_limit", "hoist", "m/s"),
        ("backlash", "hoist", "m"),
        ("sensor_bias", "position.lift", "m"),
        ("coulomb_friction", "turn", "N m"),
        ("dead_zone", "spin", "rad/s"),
        ("rate_limit", "spin", "rad/s^2"),
        ("sensor_bias", "position.turn", "rad"),
        ("coulomb_friction", None, "N m"),  # of joints of both kinds
        ("payload", None, "kg"),
    ],
)
def test_units_on_joints_that_slide_and_that_turn(tmp_path: Path, effect: str, target: str | None, unit: str) -> None:
    robot = robot_of(tmp_path, MIXED)
    assert unit_of(robot, Term(effect, target), BY_NAME[effect].parameters[0].unit) == unit


def test_an_actuator_with_the_name_of_another_joint(tmp_path: Path) -> None:
    robot = robot_of(tmp_path, MIXED.replace('name="hoist"', 'name="turn"').replace('name="spin"', 'name="lift"'))
    for effect, target, unit in (
        ("coulomb_friction", "lift", "N"), ("coulomb_friction", "turn", "N m"),
        ("dead_zone", "turn", "m"), ("dead_zone", "lift", "rad/s"),
    ):  # fmt: skip
        assert unit_of(robot, Term(effect, target), BY_NAME[effect].parameters[0].unit) == unit


def test_all_joints_alike_have_forces_where_all_of_them_slide(tmp_path: Path) -> None:
    robot = robot_of(tmp_path, SLIDES)
    assert unit_of(robot, Term("coulomb_friction", None), "N m") == "N"
    assert unit_of(robot, Term("base_tilt", None), "rad") == "rad"


def test_wheels_turn() -> None:
    assert unit_of(ROVER, Term("rate_limit", None), "command unit/s") == "rad/s^2"
    assert unit_of(ROVER, Term("sensor_bias", "pose.theta"), "channel unit") == "rad"


def test_all_actuators_alike_slide_where_what_turns_has_no_motor(tmp_path: Path) -> None:
    """A cart with a pendulum."""
    spin = '<velocity name="spin" joint="turn" kv="5"/>'
    robot = robot_of(tmp_path, MIXED.replace(spin, ""))
    assert unit_of(robot, Term("rate_limit", None), "command unit/s") == "m/s"
    assert unit_of(robot, Term("coulomb_friction", None), "N m") == "N m"
