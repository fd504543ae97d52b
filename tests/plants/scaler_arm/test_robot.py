"""The arm as a robot of the diagnosis: it keeps the contract, and its passive joints follow from the motors."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from postures import anywhere

from plants.mujoco_robot import build as build_any
from plants.mujoco_robot.structure.loops import find_loops
from plants.scaler_arm.engines.mjcf import mjcf
from plants.scaler_arm.kinematics.geometry import HOME, MOTORS, PASSIVE
from plants.scaler_arm.robot import FiveBarLoop, build
from residual_mpc.errors import BadInput
from residual_mpc.models.contract import check_robot
from residual_mpc.models.protocol import Drive
from residual_mpc.models.robot_file import RobotFile
from residual_mpc.models.settings import Settings

ARM = RobotFile("scaler_arm", "scaler_arm")


def test_it_keeps_the_contract() -> None:
    check_robot(build(ARM), np.random.default_rng(0), size=0.3)


def test_any_models_loop_is_solved_and_ours_in_closed_form_alike() -> None:
    """Newton's method on the engine's constraint against the analytic linkage, all over the workspace."""
    robot = build(ARM)
    assert isinstance(robot.loops, FiveBarLoop)
    newton = find_loops(robot.model, "the arm")
    assert newton is not None and newton.passive == PASSIVE
    q, v = np.zeros((100, robot.model.nq)), np.zeros((100, robot.model.nv))
    q[:, robot.loops.places[:6]] = anywhere(100, seed=11)
    v[:, robot.loops.dofs[:6]] = np.random.default_rng(12).standard_normal((100, 6))
    q_too, v_too = q.copy(), v.copy()
    robot.loops.close(q, v)
    newton.close(q_too, v_too)
    assert np.abs(q[:, robot.loops.places[6:]]).max() > 0.5
    np.testing.assert_allclose(q_too, q, rtol=0, atol=1e-7)
    np.testing.assert_allclose(v_too, v, rtol=0, atol=1e-7)


def test_a_model_file_of_a_closed_chain_is_a_robot_too(tmp_path: Path) -> None:
    """The same replay, whether the loop is closed by the file's equality or by the arm's own formula."""
    path = tmp_path / "arm.xml"
    path.write_text(mjcf())
    ours, theirs = build(ARM), build_any(RobotFile("arm", "mujoco", model=path))
    assert theirs.passive == PASSIVE and theirs.states == ours.states
    rows, steps = 3, 100
    q = anywhere(10, seed=13)[4 : 4 + rows]
    start = {f"position.{m}": q[:, i] for i, m in enumerate(MOTORS)} | {f"velocity.{m}": np.zeros(rows) for m in MOTORS}
    command = np.repeat(np.array(HOME)[None, None], rows, axis=0).repeat(steps, axis=1)
    drive = Drive(ours.step, 0, command, None, np.zeros(rows))
    wanted = (*(f"position.{m}" for m in MOTORS), *(f"position.{j}" for j in PASSIVE))
    one, other = (r.replay(start, drive, Settings(rows), wanted) for r in (ours, theirs))
    for channel in wanted:
        np.testing.assert_allclose(one[channel], other[channel], rtol=0, atol=1e-6)
    # the loop is closed at the start: the constraint has nothing to pull at
    model = mujoco.MjModel.from_xml_string(mjcf())
    data = mujoco.MjData(model)
    for i, name in enumerate((*MOTORS, *PASSIVE)):
        data.joint(name).qpos[0] = one[wanted[i]][0, 0]
    mujoco.mj_forward(model, data)
    assert np.abs(data.site("loop_b").xpos - data.site("loop_e").xpos).max() < 1e-12


def test_servo_figures_may_be_named_in_the_file() -> None:
    robot = build(RobotFile("arm", "scaler_arm", parameters={"stiffness": 35.0, "damping": 2.0}))
    assert robot.nominal()["actuator.wrist2.kp"] == 35.0 and robot.nominal()["actuator.f.kv"] == 2.0
    with pytest.raises(BadInput, match="parameters of scaler_arm are stiffness, damping"):
        build(RobotFile("arm", "scaler_arm", parameters={"wheel_radius": 0.03}))
    with pytest.raises(BadInput, match="positive"):
        build(RobotFile("arm", "scaler_arm", parameters={"damping": -1.0}))
