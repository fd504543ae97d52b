"""Springs, constant torques, stops, a tilted base and limits of rate and speed, against models and loops that MuJoCo
itself steps."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from oracles.arms import CHANNELS, DT, arm_xml, literal, random_drive, random_start, robot_of, settings_of

from plants.mujoco_robot.edits.surroundings import is_upper
from residual_mpc.models.protocol import Drive

STEPS = 200


def compared(tmp_path: Path, hypothesis: dict, model: mujoco.MjModel) -> None:
    """Check a hypothesis against another model, and a row without effects in the same batch against the robot's own."""
    robot = robot_of(tmp_path, arm_xml())
    drive, start = random_drive(robot, 2, STEPS), random_start(robot, 2)
    came = robot.replay(start, drive, settings_of(robot, hypothesis, {}), CHANNELS)
    for row, truth in enumerate((model, robot.model)):
        q, v, _ = literal(truth, start, drive.command[row, drive.lead :], row)
        for j, joint in enumerate(("j1", "j2")):
            np.testing.assert_allclose(came[f"position.{joint}"][row], q[:, j], rtol=0, atol=1e-7)
            np.testing.assert_allclose(came[f"velocity.{joint}"][row], v[:, j], rtol=0, atol=1e-5)
    plain = literal(robot.model, start, drive.command[0, drive.lead :], 0)[0]
    assert np.abs(came["position.j1"][0] - plain[:, 0]).max() > 1e-3


def changed(**fields: object) -> mujoco.MjModel:
    """The arm compiled with other attributes of its joint j1."""
    spec = mujoco.MjSpec.from_string(arm_xml())
    for name, value in fields.items():
        setattr(spec.joint("j1"), name, value)
    return spec.compile()


def test_a_spring_is_the_one_in_the_file(tmp_path: Path) -> None:
    springy = arm_xml().replace('name="j1" axis', 'name="j1" stiffness="4" springref="40" axis')
    rest = float(np.deg2rad(40))
    hypothesis = {("joint_spring", "j1", "stiffness"): 4.0, ("joint_spring", "j1", "rest"): rest}
    compared(tmp_path, hypothesis, mujoco.MjModel.from_xml_string(springy))


def test_two_springs_add_up(tmp_path: Path) -> None:
    """A spring beside one that the model has already is one spring between both rest positions."""
    own = arm_xml().replace('name="j1" axis', 'name="j1" stiffness="2" springref="-30" axis')
    robot = robot_of(tmp_path, own)
    both = {("joint_spring", "j1", "stiffness"): 3.0, ("joint_spring", "j1", "rest"): 0.5}
    drive, start = random_drive(robot, 1, STEPS), random_start(robot, 1)
    came = robot.replay(start, drive, settings_of(robot, both), CHANNELS)
    one = mujoco.MjModel.from_xml_string(own)
    one.jnt_stiffness[0] = 5.0
    one.qpos_spring[0] = (3.0 * 0.5 + 2.0 * np.deg2rad(-30)) / 5.0
    q, _, _ = literal(one, start, drive.command[0, drive.lead :], 0)
    np.testing.assert_allclose(came["position.j1"][0], q[:, 0], rtol=0, atol=1e-11)


def test_a_constant_torque_is_an_applied_one(tmp_path: Path) -> None:
    robot = robot_of(tmp_path, arm_xml())
    drive, start = random_drive(robot, 1, STEPS), random_start(robot, 1)
    came = robot.replay(start, drive, settings_of(robot, {("torque_offset", "j1", "torque"): 0.7}), CHANNELS)
    data = mujoco.MjData(robot.model)
    data.qpos[:], data.qvel[:] = (np.array([start[f"{k}.j{i}"][0] for i in (1, 2)]) for k in ("position", "velocity"))
    for k, u in enumerate(drive.command[0, drive.lead :]):
        data.ctrl[:], data.qfrc_applied[:] = u, (0.7, 0.0)
        mujoco.mj_step(robot.model, data)
        np.testing.assert_allclose([came[f"position.j{i}"][0, k + 1] for i in (1, 2)], data.qpos, rtol=0, atol=1e-7)


def test_a_stop_is_a_range(tmp_path: Path) -> None:
    compared(tmp_path, {("end_stop", "j1", "position"): 0.05}, changed(limited=True, range=(-1e6, np.rad2deg(0.05))))


@pytest.mark.parametrize(("joint", "position", "upper"), [("j1", 0.1, True), ("j1", -0.1, False), ("j2", 0.2, True)])
def test_a_stop_holds_from_the_side_where_it_lies(tmp_path: Path, joint: str, position: float, upper: bool) -> None:
    assert is_upper(robot_of(tmp_path, arm_xml()), joint, np.array([position]))[0] == upper


def test_a_tilted_base_is_one_whose_first_body_is_turned(tmp_path: Path) -> None:
    """Gravity in the base's frame; the first axis of the arm turns with the base."""
    robot = robot_of(tmp_path, arm_xml())
    drive, start = random_drive(robot, 1, STEPS), random_start(robot, 1)
    tilt = {("base_tilt", None, "roll"): 0.15, ("base_tilt", None, "pitch"): -0.1}
    came = robot.replay(start, drive, settings_of(robot, tilt), CHANNELS)
    spec = mujoco.MjSpec.from_string(arm_xml())
    about_x, about_y, both = np.zeros(4), np.zeros(4), np.zeros(4)
    mujoco.mju_axisAngle2Quat(about_x, np.array([1.0, 0, 0]), 0.15)
    mujoco.mju_axisAngle2Quat(about_y, np.array([0, 1.0, 0]), -0.1)
    mujoco.mju_mulQuat(both, about_y, about_x)
    spec.body("upper").quat = both
    q, _, _ = literal(spec.compile(), start, drive.command[0, drive.lead :], 0)
    np.testing.assert_allclose(came["position.j1"][0], q[:, 0], rtol=0, atol=1e-9)
    np.testing.assert_allclose(came["position.j2"][0], q[:, 1], rtol=0, atol=1e-9)


def test_a_motor_gives_no_more_than_its_line(tmp_path: Path) -> None:
    """At every step the force lies under the line at the joint's speed before it."""
    robot = robot_of(tmp_path, arm_xml())
    n = 300
    command = np.repeat(np.where(np.arange(n) % 100 < 50, 3.0, -3.0)[None, :, None], 2, axis=2)
    start = {c: np.zeros(1) for c in CHANNELS}
    stall, free = 2.0, 3.0
    line = {("torque_speed_limit", "j2", "stall_torque"): stall, ("torque_speed_limit", "j2", "no_load_speed"): free}
    wanted = (*CHANNELS, "output.j2")
    came = robot.replay(start, Drive(DT, 0, command, None, np.zeros(1), None), settings_of(robot, line), wanted)
    speed, force = came["velocity.j2"][0, :-1], came["output.j2"][0, :-1]
    most = stall * np.clip(1.0 - np.sign(force) * speed / free, 0.0, 1.0)
    assert (np.abs(force) <= most + 1e-5).all()
    assert (np.abs(force) > 0.99 * most - 1e-5).mean() > 0.3  # it acts


def test_a_setpoint_ramps(tmp_path: Path) -> None:
    robot = robot_of(tmp_path, arm_xml())
    drive, start = random_drive(robot, 1, STEPS), random_start(robot, 1)
    came = robot.replay(start, drive, settings_of(robot, {("rate_limit", "j1", "rate"): 0.9}), CHANNELS)
    ramp, at, fine = [], drive.command[0, 0, 0], 10_000
    for u in drive.command[0, :, 0]:  # held over the step, in which the setpoint moves evenly until it arrives
        on_the_way = at + np.sign(u - at) * np.minimum(0.9 * DT * (np.arange(fine) + 0.5) / fine, abs(u - at))
        ramp.append(float(on_the_way.mean()))
        at += float(np.clip(u - at, -0.9 * DT, 0.9 * DT))
    control = drive.command[0].copy()
    control[:, 0] = ramp
    q, _, _ = literal(robot.model, start, control[drive.lead :], 0)
    np.testing.assert_allclose(came["position.j1"][0], q[:, 0], rtol=0, atol=1e-8)


def test_the_mjcf_holds_springs_torques_stops_and_tilt(tmp_path: Path) -> None:
    robot = robot_of(tmp_path, arm_xml())
    beside = {
        ("joint_spring", "j1", "stiffness"): 4.0, ("joint_spring", "j1", "rest"): 0.5,
        ("torque_offset", "j2", "torque"): 0.3, ("end_stop", "j1", "position"): 0.2,
        ("base_tilt", None, "roll"): 0.1, ("base_tilt", None, "pitch"): 0.05,
    }  # fmt: skip
    made = robot.to_mjcf(settings_of(robot, beside), tmp_path)
    assert made.left_out == () and made.apart < 1e-6
