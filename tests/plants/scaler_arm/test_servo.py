"""The arm without inertia: its weight is what MuJoCo holds up, its servos give way by it, and it is a robot."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from postures import anywhere

from plants.scaler_arm.dynamics.gravity import masses
from plants.scaler_arm.dynamics.servo import Load, Servo, advance, weights
from plants.scaler_arm.engines.mjcf import mjcf
from plants.scaler_arm.kinematics.forward import chain
from plants.scaler_arm.kinematics.geometry import MOTORS, PASSIVE, SCALER
from plants.scaler_arm.kinematics.loop_closure import closed
from plants.scaler_arm.servo_robot import ServoArm, build
from residual_mpc.effects.ops import NUMPY
from residual_mpc.errors import BadInput
from residual_mpc.models.contract import check_robot
from residual_mpc.models.robot_file import RobotFile


def test_the_weight_is_what_mujoco_holds_up():
    model = mujoco.MjModel.from_xml_string(mjcf())
    data = mujoco.MjData(model)
    names = MOTORS + PASSIVE
    places = [int(model.joint(n).qposadr[0]) for n in names]
    dofs = [int(model.joint(n).dofadr[0]) for n in names]
    for q in anywhere(30):
        data.qpos[places] = np.append(q, closed(q, np.zeros(6), SCALER).passive)
        data.qvel[:] = 0.0
        mujoco.mj_forward(model, data)
        turns = np.array([closed(q, e, SCALER).rates for e in np.eye(6)])  # (6, 2) of the passive joints
        wanted = data.qfrc_bias[dofs[:6]] + turns @ data.qfrc_bias[dofs[6:]]
        mine = weights(NUMPY, SCALER, chain(SCALER), [*q], Load(masses(SCALER), 0.0, {}, {}))
        np.testing.assert_allclose(mine, wanted, atol=1e-13)


def test_a_servo_at_rest_gives_way_by_its_weight_and_dry_friction_holds():
    law = Servo(60.0, 6.0, 0.02)
    assert advance(NUMPY, NUMPY, law, 0.3 / 60.0, 0.3, 0.01) == pytest.approx(0.0, abs=1e-18)
    rubbing = Servo(60.0, 6.0, 0.02, 0.2)
    assert advance(NUMPY, NUMPY, rubbing, 0.49 / 60.0, 0.3, 0.01) == 0.0
    assert advance(NUMPY, NUMPY, rubbing, 0.51 / 60.0, 0.3, 0.01) > 0.0


def test_two_half_steps_are_one_step():
    law = Servo(60.0, 6.0, 0.02)
    first = advance(NUMPY, NUMPY, law, 0.1, 0.3, 0.005)
    second = advance(NUMPY, NUMPY, law, 0.1 - first, 0.3, 0.005)
    assert first + second == pytest.approx(advance(NUMPY, NUMPY, law, 0.1, 0.3, 0.01), rel=1e-12)


def test_it_keeps_a_robots_contract():
    check_robot(ServoArm("scaler_arm_servo"), np.random.default_rng(3))


def test_parameters_are_those_of_the_arm():
    assert build(RobotFile("stiff", "scaler_arm_servo", parameters={"stiffness": 600.0})).arm.servo.stiffness == 600.0
    with pytest.raises(BadInput, match="unknown parameter"):
        build(RobotFile("stiff", "scaler_arm_servo", parameters={"stifness": 600.0}))


def test_a_load_beside_the_tool_weighs_as_one_at_a_tool_that_is_there() -> None:
    offset = (0.03, -0.02, 0.05)
    moved = replace(SCALER, tool=tuple(a + b for a, b in zip(SCALER.tool, offset, strict=True)))
    for q in anywhere(5):
        beside = weights(NUMPY, SCALER, chain(SCALER), [*q], Load(masses(SCALER), 0.4, {}, {}, offset))
        there = weights(NUMPY, moved, chain(moved), [*q], Load(masses(moved), 0.4, {}, {}))
        at_tool = weights(NUMPY, SCALER, chain(SCALER), [*q], Load(masses(SCALER), 0.4, {}, {}))
        np.testing.assert_allclose(beside, there, atol=1e-9)
        assert np.abs(np.subtract(beside, at_tool)).max() > 0.01
