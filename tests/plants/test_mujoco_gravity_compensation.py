"""A controller that bears the weight of the modelled robot, against loops that add MuJoCo's own gravity torques."""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

import mujoco
import numpy as np
import pytest
from oracles.arms import (
    CHANNELS,
    DT,
    SERVOS,
    Hypothesis,
    arm_xml,
    assert_rows_are_themselves,
    random_drive,
    random_start,
    robot_of,
    settings_of,
)

from plants.mujoco_robot.simulation import compiled_steps, replay

STEPS = 200
SOFT = SERVOS.replace('kp="30"', 'kp="4"').replace('kp="20"', 'kp="6"')  # servos in which the arm sags
SHARE = {("gravity_compensation", None, "share"): 0.9}
LOADED = {
    ("payload", None, "mass"): 0.5, ("payload", None, "x"): 0.04,
    ("link_mass", "upper", "mass"): 0.3, ("link_mass", "upper", "com"): 0.05,
    ("link_length", "upper", "offset"): 0.04, ("base_tilt", None, "roll"): 0.1, ("base_tilt", None, "pitch"): -0.15,
}  # fmt: skip


def weight(nominal: mujoco.MjModel, q: np.ndarray) -> np.ndarray:
    """(nv,) N m of a model at rest at q."""
    data = mujoco.MjData(nominal)
    data.qpos[:] = q
    mujoco.mj_forward(nominal, data)
    return data.qfrc_bias.copy()


def loaded(model: mujoco.MjModel) -> mujoco.MjModel:
    """The arm with LOADED, by the specification of its file."""
    spec = mujoco.MjSpec.from_string(arm_xml(SOFT))
    upper, lower = spec.body("upper"), spec.body("lower")
    for body, mass, along in ((upper, 0.3, 0.05), (lower, 0.0, 0.0)):
        b = model.body(body.name).id
        line = model.body("lower").pos / np.linalg.norm(model.body("lower").pos)
        body.explicitinertial, body.mass = True, model.body_mass[b] + mass
        body.ipos, body.iquat = model.body_ipos[b] + along * line, model.body_iquat[b]
        body.inertia, body.fullinertia = model.body_inertia[b], np.full(6, np.nan)
    lower.pos = model.body("lower").pos + 0.04 * line
    held = lower.add_body(name="held")
    held.explicitinertial, held.mass, held.inertia = True, 0.5, np.full(3, 1e-9)
    held.ipos = model.site("tool").pos + [0.04, 0.0, 0.0]
    about_x, about_y, both = np.zeros(4), np.zeros(4), np.zeros(4)
    mujoco.mju_axisAngle2Quat(about_x, np.array([1.0, 0, 0]), 0.1)
    mujoco.mju_axisAngle2Quat(about_y, np.array([0, 1.0, 0]), -0.15)
    mujoco.mju_mulQuat(both, about_y, about_x)
    upper.quat = both
    return spec.compile()


def truth(
    model: mujoco.MjModel, nominal: mujoco.MjModel, start: dict[str, np.ndarray], controls: np.ndarray, finer: int,
    share: np.ndarray | float = 0.9,
) -> np.ndarray:  # fmt: skip
    """Positions (K + 1, 2) of row 0 where share g(q) of the nominal model is added at every one of `finer` steps."""
    model.opt.timestep = DT / finer
    data = mujoco.MjData(model)
    for i in (1, 2):
        data.joint(f"j{i}").qpos[0] = start[f"position.j{i}"][0]
        data.joint(f"j{i}").qvel[0] = start[f"velocity.j{i}"][0]
    out = [data.qpos.copy()]
    for u in controls:
        data.ctrl[:] = u
        for _ in range(finer):
            data.qfrc_applied[:] = share * weight(nominal, data.qpos)
            mujoco.mj_step(model, data)
        out.append(data.qpos.copy())
    return np.array(out)


@pytest.mark.parametrize("beside", [{}, LOADED], ids=["alone", "with a load, another mass and length, and a tilt"])
def test_the_weight_of_the_nominal_model_is_borne(tmp_path: Path, beside: Hypothesis) -> None:
    robot = robot_of(tmp_path, arm_xml(SOFT), payload_site="tool")
    drive, start = random_drive(robot, 1, STEPS), random_start(robot, 1)
    came = robot.replay(start, drive, settings_of(robot, {**SHARE, **beside}), CHANNELS)
    found = np.stack([came[f"position.j{i}"][0] for i in (1, 2)], axis=1)
    controls = drive.command[0, drive.lead :]
    model = loaded(robot.model) if beside else mujoco.MjModel.from_xml_string(arm_xml(SOFT))
    np.testing.assert_allclose(found, truth(model, robot.model, start, controls, 1), rtol=0, atol=2e-6)
    fine = truth(model, robot.model, start, controls, 10)
    assert np.abs(found - fine).max() < 0.02  # what the model's own time step leaves out, with or without the effect
    without = robot.replay(start, drive, settings_of(robot, beside), CHANNELS)
    assert np.abs(without["position.j1"][0] - fine[:, 0]).max() > 0.1


def compensated(xml: str) -> str:
    """The same model with a gravcomp of 1 on both links."""
    return xml.replace('<body name="upper"', '<body name="upper" gravcomp="1"').replace(
        '<body name="lower"', '<body name="lower" gravcomp="1"'
    )


@pytest.mark.parametrize("beside", [{}, LOADED], ids=["alone", "with a load, another mass and length, and a tilt"])
def test_gravcomp_of_the_model_bears_its_nominal_weight(tmp_path: Path, beside: Hypothesis) -> None:
    """A controller that MuJoCo's gravcomp stands for knows of no payload."""
    robot = robot_of(tmp_path, compensated(arm_xml(SOFT)), payload_site="tool")
    drive, start = random_drive(robot, 1, STEPS), random_start(robot, 1)
    came = robot.replay(start, drive, settings_of(robot, beside), CHANNELS)
    found = np.stack([came[f"position.j{i}"][0] for i in (1, 2)], axis=1)
    plain = mujoco.MjModel.from_xml_string(arm_xml(SOFT))
    model = loaded(plain) if beside else copy(plain)
    expected = truth(model, plain, start, drive.command[0, drive.lead :], 1, 1.0)
    np.testing.assert_allclose(found, expected, rtol=0, atol=2e-6)


def test_gravcomp_that_acts_through_the_actuators_is_mujocos_own(tmp_path: Path) -> None:
    """The actuators' limits hold for it, so the payload's weight is borne as MuJoCo bears it."""
    xml = compensated(arm_xml(SOFT)).replace('<joint name="j1"', '<joint name="j1" actuatorgravcomp="true"')
    robot = robot_of(tmp_path, xml, payload_site="tool")
    drive, start = random_drive(robot, 1, STEPS), random_start(robot, 1)
    mass = {("link_mass", "lower", "mass"): 0.4}
    came = robot.replay(start, drive, settings_of(robot, mass), CHANNELS)
    model = mujoco.MjModel.from_xml_string(xml)
    assert model.jnt_actgravcomp.any()
    lower = model.body("lower").id
    model.body_mass[lower] += 0.4
    mujoco.mj_setConst(model, mujoco.MjData(model))
    expected = truth(model, robot.model, start, drive.command[0, drive.lead :], 1, 0.0)
    for i in (1, 2):
        np.testing.assert_allclose(came[f"position.j{i}"][0], expected[:, i - 1], rtol=0, atol=2e-6)


def test_rows_of_a_model_with_gravcomp_are_themselves(tmp_path: Path) -> None:
    robot = robot_of(tmp_path, compensated(arm_xml(SOFT)), payload_site="tool")
    friction = {("coulomb_friction", None, "torque"): 0.2}
    assert_rows_are_themselves(robot, [{}, LOADED, friction, {**friction, ("payload", None, "mass"): 0.2}], 60)


def test_the_mjcf_of_a_model_with_gravcomp_keeps_the_nominal_weight(tmp_path: Path) -> None:
    robot = robot_of(tmp_path, compensated(arm_xml(SOFT)))
    made = robot.to_mjcf(settings_of(robot, {("link_mass", "upper", "mass"): 0.4}), tmp_path)
    model = mujoco.MjModel.from_xml_string(made.text)
    np.testing.assert_allclose(model.body_gravcomp, [0.0, 0.8 / 1.2, 1.0], rtol=1e-6)
    assert made.apart < 1e-6


@pytest.mark.parametrize("feedback", ["motor", "link"])
@pytest.mark.parametrize("integrator", ["implicitfast", "RK4"])
def test_the_compiled_steps_are_those_of_mujoco(tmp_path: Path, integrator: str, feedback: str) -> None:
    """Beside play, a soft gear, a ripple and an integral part, with motors that are switched off."""
    xml = arm_xml(SERVOS, integrator).replace("<default>", '<option tolerance="0" ls_tolerance="1e-6"/><default>')
    robot = robot_of(tmp_path, xml, servo_feedback=feedback)
    beside = {
        ("joint_compliance", "j1", "stiffness"): 60.0, ("backlash", "j2", "gap"): 0.03,
        ("torque_ripple", "j1", "amplitude"): 0.3, ("torque_ripple", "j1", "cycles"): 9.0,
        ("servo_integral", None, "gain"): 2.0, ("payload", None, "mass"): 0.2,
    }  # fmt: skip
    on = np.repeat(np.random.default_rng(4).uniform(0.0, 1.0, (3, 4, 2)) > 0.3, 30, axis=1).astype(float)
    drive, start = replace(random_drive(robot, 3, 120), enabled=on), random_start(robot, 3)
    settings = settings_of(robot, beside, SHARE | beside, SHARE)
    compiled = robot.replay(start, drive, settings, CHANNELS)
    with (
        patch.object(replay, "native_arm", lambda robot: None),
        patch.object(compiled_steps, "native_arm", lambda robot: None),
    ):
        stepped = robot.replay(start, drive, settings, CHANNELS)
    for channel in CHANNELS:
        np.testing.assert_allclose(compiled[channel], stepped[channel], rtol=0, atol=1e-8)


def test_rows_with_and_without_it_are_themselves(tmp_path: Path) -> None:
    robot = robot_of(tmp_path, arm_xml())
    assert_rows_are_themselves(robot, [{}, SHARE, {**SHARE, **LOADED}, {("payload", None, "mass"): 0.2}], 60)


def test_a_motor_that_is_off_bears_nothing(tmp_path: Path) -> None:
    robot = robot_of(tmp_path, arm_xml())
    drive, start = replace(random_drive(robot, 1, 50), enabled=np.zeros((1, 50, 2))), random_start(robot, 1)
    settings = settings_of(robot, SHARE)
    off, plain = (robot.replay(start, drive, s, CHANNELS) for s in (settings, settings_of(robot, {})))
    for channel in CHANNELS:
        np.testing.assert_allclose(off[channel], plain[channel], rtol=0, atol=1e-12)


def test_each_setting_of_a_robot_has_the_weight_of_its_own_model(tmp_path: Path) -> None:
    heavy = arm_xml().replace('mass="0.8"', 'mass="1.6"')
    (tmp_path / "heavy").mkdir()
    one, other = robot_of(tmp_path, arm_xml()), robot_of(tmp_path / "heavy", heavy)
    both = one.merged([other])
    assert both is not None
    drive, start = random_drive(one, 2, 60), random_start(one, 2)
    came = both.replay(start, replace(drive, setting=np.array([0, 1])), settings_of(both, SHARE, SHARE), CHANNELS)
    for row, robot in enumerate((one, other)):
        mine = replace(drive, command=drive.command[row : row + 1], clock=drive.clock[row : row + 1])
        alone = robot.replay({k: x[row : row + 1] for k, x in start.items()}, mine, settings_of(robot, SHARE), CHANNELS)
        for channel in CHANNELS:
            np.testing.assert_allclose(came[channel][row], alone[channel][0], rtol=0, atol=1e-10)


def test_only_joints_with_a_motor_are_borne(tmp_path: Path) -> None:
    """The second link swings freely: nothing but the first motor can bear weight."""
    robot = robot_of(tmp_path, arm_xml('<position name="j1" joint="j1" kp="30" kv="1.5"/>'))
    drive, start = random_drive(robot, 1, 60), random_start(robot, 1)
    came = robot.replay(start, drive, settings_of(robot, SHARE), CHANNELS)
    expected = truth(copy(robot.model), robot.model, start, drive.command[0, drive.lead :], 1, np.array([0.9, 0.0]))
    for i in (1, 2):
        np.testing.assert_allclose(came[f"position.j{i}"][0], expected[:, i - 1], rtol=0, atol=2e-6)


@pytest.mark.parametrize(
    ("xml", "there"),
    [
        (arm_xml(), True),
        (arm_xml(gravity=0.0), False),
        (arm_xml().replace('<body name="lower"', '<body name="lower" gravcomp="1"'), False),
    ],
    ids=["gravity", "no gravity", "a model that compensates"],
)
def test_where_there_may_be_a_compensation(tmp_path: Path, xml: str, there: bool) -> None:
    assert bool(robot_of(tmp_path, xml).slots("gravity_compensation")) is there


def test_the_mjcf_has_gravcomp_of_the_nominal_masses(tmp_path: Path) -> None:
    robot = robot_of(tmp_path, arm_xml(SOFT))
    made = robot.to_mjcf(settings_of(robot, {**SHARE, ("link_mass", "upper", "mass"): 0.4}), tmp_path)
    assert made.left_out == () and made.apart < 1e-6
    model = mujoco.MjModel.from_xml_string(made.text)
    np.testing.assert_allclose(model.body_gravcomp, [0.0, 0.9 * 0.8 / 1.2, 0.9], rtol=1e-6)


@pytest.mark.parametrize("name", ["payload", "base_tilt", "link_length"])
def test_an_mjcf_whose_weight_acts_elsewhere_leaves_it_out(tmp_path: Path, name: str) -> None:
    robot = robot_of(tmp_path, arm_xml(SOFT), payload_site="tool")
    moved = {knob: value for knob, value in LOADED.items() if knob[0] == name}
    made = robot.to_mjcf(settings_of(robot, {**SHARE, **moved}), tmp_path)
    (said,) = made.left_out
    assert said.startswith("gravity_compensation: gravcomp follows the centres of mass") and made.apart < 1e-6
    assert "gravcomp" not in made.text


def test_an_integral_part_begins_with_what_is_not_compensated(tmp_path: Path) -> None:
    """With all of the weight borne it has nothing to hold: an arm at its setpoint stays there."""
    robot = robot_of(tmp_path, arm_xml(SOFT))
    still = {c: np.zeros(1) for c in CHANNELS}
    both = {("gravity_compensation", None, "share"): 1.0, ("servo_integral", None, "gain"): 2.0}
    drive = replace(random_drive(robot, 1, 50), command=np.zeros((1, 200, 2)))
    came = robot.replay(still, drive, settings_of(robot, both), CHANNELS)
    assert max(np.abs(came[c]).max() for c in CHANNELS) < 1e-9
