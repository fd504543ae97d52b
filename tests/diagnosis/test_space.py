"""The hypotheses of a robot on given runs: which there are, and how far their numbers may go."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from oracles.arms import MIXED, SERVOS, arm_xml, robot_of

from plants.mujoco_robot import MujocoRobot
from residual_mpc.diagnosis.data.dataset import build_dataset, compared_channels
from residual_mpc.diagnosis.data.gap import measure_scales, still_channels
from residual_mpc.diagnosis.predict.candidates import build_space
from residual_mpc.diagnosis.predict.space import Space
from residual_mpc.effects.library import LIBRARY
from residual_mpc.logs.run import Run
from residual_mpc.models.settings import TUNE, Knob, Term


def space_of(robot: MujocoRobot, speeds: tuple[float, float]) -> Space:
    """Runs in which the joints bear 0.4 N m (root mean square) at these speeds, rad/s."""
    references = {("torque", j): 0.4 for j in robot.joints}
    references |= {("torque/speed", j): 0.4 / w for j, w in zip(robot.joints, speeds, strict=True)}
    return Space(robot, {e.name: robot.slots(e.name) for e in LIBRARY}, (), (), references, {})


@pytest.mark.parametrize(("actuators", "servoed"), [(SERVOS, ["j1", "j2"]), (MIXED, [])])
def test_a_ripple_leads_only_at_servos_with_damping(tmp_path: Path, actuators: str, servoed: list[str]) -> None:
    space = space_of(robot_of(tmp_path, arm_xml(actuators)), (0.5, 2.0))
    leading = [j for j in ("j1", "j2") if space.optional(Term("torque_ripple", j))]
    assert leading == servoed


def test_viscous_friction_is_at_most_what_the_motor_overcomes_at_the_runs_speed(tmp_path: Path) -> None:
    space = space_of(robot_of(tmp_path, arm_xml(SERVOS)), (0.5, 2.0))
    most = {j: space.bounds(Knob("viscous_friction", j, "coefficient"))[1] for j in ("j1", "j2", None)}
    assert most["j2"] == pytest.approx(3.0 / 2.0)  # 3 N m at 2 rad/s
    assert most["j1"] == np.inf  # nothing is said of its force
    assert most[None] == pytest.approx(1.5)
    motor = MIXED.replace('gear="3"', 'gear="3" ctrlrange="-2 2"').replace('kv="0.9"', 'kv="0.9" forcerange="-9 9"')
    both = space_of(robot_of(tmp_path, arm_xml(motor)), (0.5, 2.0))
    assert both.bounds(Knob("viscous_friction", None, "coefficient"))[1] == pytest.approx(9.0 / 2.0)
    assert both.bounds(Knob("viscous_friction", "j1", "coefficient")) == pytest.approx((-0.1, 6.0 / 0.5))


def test_what_is_tunable_at_a_joint_that_stands_still_keeps_its_value(tmp_path: Path) -> None:
    """Nothing in the runs shows another, and a fit would leave it anywhere."""
    t = 0.02 * np.arange(400)
    columns = {
        f"{what}.j{k}": (np.sin(t + k) if k == 1 else 0.0 * t) for what in ("command", "position") for k in (1, 2)
    }
    data = build_dataset([Run("r", t, columns)], [robot_of(tmp_path, arm_xml(SERVOS))], {})
    still = still_channels(data, measure_scales(data))
    assert still == ("position.j2",)
    free = [k.parameter for k in build_space(data, ("actuator.*.kp", "joint.*.damping"), still=still).tunables]
    assert free == ["joint.j1.damping", "actuator.j1.kp"]
    assert len(build_space(data, ("actuator.*.kp", "joint.*.damping")).tunables) == 4


def test_a_joint_that_is_held_is_neither_compared_nor_tuned(tmp_path: Path) -> None:
    """A gripper that nobody commands wobbles within its play; where it starts still counts."""
    t = 0.02 * np.arange(400)
    columns = {"command.j1": np.sin(t), "position.j1": np.sin(t), "position.j2": 0.3 + 0.01 * np.sin(9.0 * t)}
    robot = robot_of(tmp_path, arm_xml(SERVOS), held=("j2",))
    data = build_dataset([Run("r", t, columns)], [robot], {})
    assert data.channels == ("position.j1", "position.j2") and data.compared.all(axis=0).tolist() == [True, False]
    free = [k.parameter for k in build_space(data, ("actuator.*.kp", "joint.*.damping")).tunables]
    assert free == ["joint.j1.damping", "actuator.j1.kp"]
    alone = build_dataset([Run("r", t, {"command.j1": np.sin(t), "position.j2": columns["position.j2"]})], [robot], {})
    assert alone.compared.all()  # nothing else is measured
    assert compared_channels(("pose.x", "position.x"), ("pose.x", "position.x"), ("x",)) == ("pose.x",)


def test_a_tunable_number_that_is_nil_moves_in_steps_that_matter_at_its_joint(tmp_path: Path) -> None:
    """A URDF has no rotor's inertia; other numbers move in proportion to what they are."""
    xml = arm_xml(SERVOS)
    space = space_of(robot_of(tmp_path, re.sub(r' (armature|frictionloss)="[^"]*"', "", xml)), (0.5, 2.0))
    nominal = space.robot.nominal()
    assert nominal["joint.j1.armature"] == nominal["joint.j2.frictionloss"] == 0.0 < nominal["joint.j1.damping"]
    inertia = space.robot.reference("inertia", "j1")
    assert space.scale(Knob(TUNE, None, "joint.j1.armature")) == pytest.approx(0.03 * inertia)
    assert space.scale(Knob(TUNE, None, "joint.j2.frictionloss")) == pytest.approx(0.03 * 0.4)
    assert space.scale(Knob(TUNE, None, "joint.j1.damping")) == pytest.approx(0.3 * nominal["joint.j1.damping"])
