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
from plants.scaler_arm.kinematics.geometry import HOME, MOTORS, PASSIVE, SCALER
from plants.scaler_arm.kinematics.loop_closure import closed
from plants.scaler_arm.servo_robot import ServoArm, build
from residual_mpc.effects.ops import NUMPY, Kinks
from residual_mpc.errors import BadInput
from residual_mpc.models.contract import check_robot
from residual_mpc.models.protocol import Drive
from residual_mpc.models.robot_file import RobotFile
from residual_mpc.models.settings import Settings
from residual_mpc.models.stepping import StepOptions


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


def test_a_position_gain_is_another_stiffness_in_the_replay_and_in_the_step() -> None:
    """The damping stays, so it is not what a gain of the whole actuator does."""
    robot = ServoArm("scaler_arm_servo")
    gain, steps = 0.6, 50
    by_effect = Settings(1, {"position_gain": {"gain": np.full((1, len(MOTORS)), gain)}})
    by_parameter = Settings(1, {}, {f"actuator.{m}.kp": np.full(1, gain * SCALER.servo.stiffness) for m in MOTORS})
    whole = Settings(1, {"actuator_gain": {"gain": np.full((1, len(MOTORS)), gain)}})
    start = {f"position.{m}": np.full(1, q) for m, q in zip(MOTORS, HOME, strict=True)}
    command = np.array(HOME) + 0.1 * np.sin(0.2 * np.arange(steps))[None, :, None]
    drive = Drive(robot.step, 0, command, None, np.zeros(1))
    wanted = tuple(start)
    found, expected, other = (robot.replay(start, drive, s, wanted) for s in (by_effect, by_parameter, whole))
    for channel in wanted:
        np.testing.assert_allclose(found[channel], expected[channel], atol=1e-12)
    assert max(np.abs(found[c] - other[c]).max() for c in wanted) > 1e-3
    ends = []
    for settings in (by_effect, by_parameter):
        stepped = robot.one_step(settings, StepOptions(robot.step))
        p = [n.value for n in stepped.numbers]
        ends.append(stepped.step(Kinks(NUMPY, lambda _: NUMPY, 0.0), [*HOME], [*command[0, 5]], p, None))
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-12)
