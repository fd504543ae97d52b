"""A rippling torque against mj_step with the same torque applied, in the replay, the step of controllers and the
exports."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from oracles.arms import arm_xml, assert_rows_are_themselves, random_drive, random_start, robot_of, settings_of
from oracles.own_arms import UR5E

from residual_mpc.export import Build, augment
from residual_mpc.export.moving import moving_apart
from residual_mpc.models.settings import Knob

RIPPLE = {"amplitude": 0.4, "cycles": 7.5, "phase": 0.3, "lead": 0.02}


def on(joint: str) -> dict[tuple[str, str | None, str], float]:
    return {("torque_ripple", joint, name): value for name, value in RIPPLE.items()}


def test_a_ripple_is_an_applied_torque(tmp_path: Path) -> None:
    robot = robot_of(tmp_path, arm_xml())
    drive, start = random_drive(robot, 1, 150), random_start(robot, 1)
    came = robot.replay(start, drive, settings_of(robot, on("j2")), ("position.j2",))
    data = mujoco.MjData(robot.model)
    data.qpos[:], data.qvel[:] = (np.array([start[f"{k}.j{i}"][0] for i in (1, 2)]) for k in ("position", "velocity"))
    plain = robot.replay(start, drive, settings_of(robot, {}), ("position.j2",))
    for k in range(150):
        data.ctrl[:] = drive.command[0, drive.lead + k]
        angle = 7.5 * data.qpos[1] + 0.3
        data.qfrc_applied[1] = 0.4 * (np.sin(angle) + 0.02 * 7.5 * data.qvel[1] * np.cos(angle))
        mujoco.mj_step(robot.model, data)
        assert came["position.j2"][0, k + 1] == pytest.approx(data.qpos[1], abs=1e-12)
    assert np.abs(plain["position.j2"][0] - came["position.j2"][0]).max() > 1e-3


def test_rows_with_a_ripple_are_themselves_beside_others(tmp_path: Path) -> None:
    offset = {("torque_offset", "j1", "torque"): 0.3}
    assert_rows_are_themselves(robot_of(tmp_path, arm_xml()), [on("j1"), {}, {**on("j2"), **offset}], 80)


def test_a_ripple_acts_in_the_step_as_in_the_replay(tmp_path: Path) -> None:
    numbers = {**RIPPLE, "amplitude": 6.0}
    values = {Knob("torque_ripple", "elbow", name): value for name, value in numbers.items()}
    model = augment(robot_of(tmp_path, UR5E), values, None, Build(0.02))
    assert not model.stepped.left_out[1:]
    assert {n for n in model.parameters if n.startswith("torque_ripple")} == {
        f"torque_ripple.elbow.{name}" for name in numbers
    }
    assert moving_apart(model, np.random.default_rng(1)) < 3e-3


def test_an_mjcf_leaves_it_out_and_says_so(tmp_path: Path) -> None:
    robot = robot_of(tmp_path, arm_xml())
    made = robot.to_mjcf(settings_of(robot, on("j1")), tmp_path)
    (said,) = made.left_out
    assert said.startswith("torque_ripple: ") and made.apart < 1e-6 < made.apart_from_all
