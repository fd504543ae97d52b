"""Fitted laws on joints and on a base: exact where they can be, and the same in replay and step."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from oracles.arms import DT, arm_xml, literal, random_drive, random_start, robot_of
from oracles.own_arms import UR5E

from plants.diff_drive import DiffDrive
from residual_mpc.effects.laws import KINDS, LawKind, curve_shape
from residual_mpc.effects.library import HOSTED
from residual_mpc.effects.ops import NUMPY
from residual_mpc.export import Build, augment
from residual_mpc.export.moving import moving_apart
from residual_mpc.models.contract import check_robot
from residual_mpc.models.protocol import Drive
from residual_mpc.models.settings import Knob, Settings, Values, assemble

ROVER = DiffDrive("rover", 0.033, 0.16)
ON_JOINTS = [k for k in KINDS if k.target == "joint"]
ON_BASE = [k for k in KINDS if k.target != "joint"]
WEAKER = next(k for k in KINDS if k.on == "load")
LEVER = next(k for k in KINDS if k.of == "strength" and k.on == "position")


def law(kind: LawKind, target: str | None, size: float) -> Values:
    if kind.shape == "wave":
        numbers = {"cycles": 5.0, "offset": 0.2 * size, "cos": 0.6 * size, "sin": 0.5 * size}
    elif kind is WEAKER:
        numbers = {**curve_shape([2.0, 20.0]), "start": 0.01 * size, "rise2": -0.04 * size}
    else:
        bent = {"start": 0.5 * size, "rise2": 0.5 * size, "rise3": -0.8 * size}
        numbers = {**curve_shape([-0.5, 0.2, 1.5]), **bent}
    return {Knob(kind.name, target, name): value for name, value in numbers.items()}


def rows(robot, *hypotheses: Values) -> Settings:
    return assemble(hypotheses, {e.name: robot.slots(e.name) for e in HOSTED})


@pytest.mark.parametrize("robot", ["arm", "rover"])
def test_the_contract_of_a_robot_holds_for_laws(tmp_path: Path, robot: str) -> None:
    """At null every law changes nothing bit for bit, alone and beside a row where it acts; elsewhere it acts."""
    check_robot(ROVER if robot == "rover" else robot_of(tmp_path, arm_xml()), np.random.default_rng(0))


def test_a_constant_law_is_a_constant_torque(tmp_path: Path) -> None:
    robot = robot_of(tmp_path, arm_xml(gravity=0.0))
    kind = next(k for k in KINDS if (k.of, k.on, k.shape) == ("torque", "time", "curve"))
    constant = {Knob(kind.name, "j1", name): v for name, v in {**curve_shape([0.0]), "start": 0.4}.items()}
    offset = {Knob("torque_offset", "j1", "torque"): 0.4}
    drive, start = random_drive(robot, 2, 200), random_start(robot, 2)
    both = robot.replay(start, drive, rows(robot, constant, offset), ("position.j1", "position.j2"))
    drive = Drive(drive.dt, drive.lead, np.repeat(drive.command[:1], 2, axis=0), None, drive.clock)
    start = {k: np.repeat(v[:1], 2) for k, v in start.items()}
    both = robot.replay(start, drive, rows(robot, constant, offset), ("position.j1", "position.j2"))
    for nodes in both.values():  # the offset is a very weak spring in MuJoCo
        np.testing.assert_allclose(nodes[0], nodes[1], atol=1e-6)


def test_a_law_of_the_position_is_the_literal_torque(tmp_path: Path) -> None:
    """Against mj_step with the same torque in qfrc_applied."""
    import mujoco

    robot = robot_of(tmp_path, arm_xml())
    kind = next(k for k in KINDS if k.shape == "wave")
    drive, start = random_drive(robot, 1, 150), random_start(robot, 1)
    found = robot.replay(start, drive, rows(robot, law(kind, "j2", 0.5)), ("position.j1", "position.j2"))
    data = mujoco.MjData(robot.model)
    data.qpos[:] = [start["position.j1"][0], start["position.j2"][0]]
    data.qvel[:] = [start["velocity.j1"][0], start["velocity.j2"][0]]
    for k in range(150):
        data.ctrl[:] = drive.command[0, drive.lead + k]
        q = data.qpos[1]
        data.qfrc_applied[1] = 0.1 + 0.3 * np.cos(5.0 * q) + 0.25 * np.sin(5.0 * q)
        mujoco.mj_step(robot.model, data)
        assert found["position.j2"][0, k + 1] == pytest.approx(data.qpos[1], abs=1e-12)
    plain, _, _ = literal(robot.model, start, drive.command[0, drive.lead :], 0)
    assert np.abs(plain[-1, 1] - data.qpos[1]) > 1e-3 and DT == robot.step


@pytest.mark.parametrize("kind", ON_JOINTS, ids=lambda k: k.name)
def test_a_law_acts_in_the_step_as_in_the_replay(tmp_path: Path, kind: LawKind) -> None:
    model = augment(robot_of(tmp_path, UR5E), law(kind, "elbow", 6.0), None, Build(0.02))
    assert not model.stepped.left_out[1:]
    assert ("clock" in model.stepped.states) == (kind.on == "time")
    assert moving_apart(model, np.random.default_rng(1)) < 3e-3


@pytest.mark.parametrize("kind", [WEAKER, LEVER], ids=lambda k: k.on)
def test_an_actuator_that_weakens_is_a_weaker_servo(tmp_path: Path, kind: LawKind) -> None:
    """Against mj_step with the servo's own law times the share that the load of the step before, or the position,
    leaves."""
    import mujoco

    robot = robot_of(tmp_path, arm_xml(gravity=9.81))
    drive, start = random_drive(robot, 1, 300), random_start(robot, 1)
    knots, values = [0.0, 3.0], [-0.05, -0.55]
    share = {**curve_shape(knots), "start": values[0], "rise2": values[1] - values[0]}
    numbers = {Knob(kind.name, "j2", name): value for name, value in share.items()}
    wanted = ("position.j1", "position.j2", *(f"output.{a}" for a in robot.actuators))
    found = robot.replay(start, drive, rows(robot, numbers), wanted)
    second = robot.actuator_joints.index("j2")
    data = mujoco.MjData(robot.model)
    data.qpos[:] = [start["position.j1"][0], start["position.j2"][0]]
    data.qvel[:] = [start["velocity.j1"][0], start["velocity.j2"][0]]
    load = 0.0
    for k in range(300):
        data.ctrl[:] = drive.command[0, drive.lead + k]
        data.qfrc_applied[1] = np.interp(abs(load) if kind is WEAKER else data.qpos[1], knots, values) * load
        mujoco.mj_step(robot.model, data)
        load = float(robot.model.actuator_gear[second, 0] * data.actuator_force[second])
        assert found["position.j2"][0, k + 1] == pytest.approx(data.qpos[1], abs=1e-12)
    assert np.abs(found[wanted[2 + second]][0]).max() > 0.5  # there is a load
    plain, _, _ = literal(robot.model, start, drive.command[0, drive.lead :], 0)
    assert np.abs(plain[-1, 1] - data.qpos[1]) > 1e-3


@pytest.mark.parametrize("joint", ["j1", "j2"])
def test_a_law_of_the_load_in_the_step_is_that_of_the_replay(tmp_path: Path, joint: str) -> None:
    """j1 has a gear of 2: without the gear half of the law would be missing, without the law all of what it moves."""
    robot = robot_of(tmp_path, arm_xml(gravity=9.81))
    share = {**curve_shape([0.0, 4.0]), "start": -0.1, "rise2": -0.5}
    values = {Knob(WEAKER.name, joint, name): value for name, value in share.items()}
    model = augment(robot, values, None, Build(DT))
    drive, start = random_drive(robot, 1, 150), random_start(robot, 1)
    wanted = ("position.j1", "position.j2")
    plain, weak = (robot.replay(start, drive, rows(robot, v), wanted) for v in ({}, values))
    x = np.array([start[s][0] if s in start else 0.0 for s in model.stepped.states])
    for k in range(150):
        x = model.numpy_step(x, drive.command[0, drive.lead + k])
    at = [model.stepped.states.index(c) for c in wanted]
    moved = max(abs(weak[c][0, -1] - plain[c][0, -1]) for c in wanted)
    assert moved > 0.02
    assert max(abs(x[i] - weak[c][0, -1]) for i, c in zip(at, wanted, strict=True)) < moved / 3.0


def test_the_load_is_what_the_joint_lets_through(tmp_path: Path) -> None:
    """A joint's own limit of force, as a URDF's effort limit becomes one, comes before the law."""
    limited = arm_xml(gravity=0.0).replace('name="j2" axis', 'name="j2" actuatorfrcrange="-0.2 0.2" axis')
    assert "actuatorfrcrange" in limited
    robot = robot_of(tmp_path, limited)
    share = {**curve_shape([0.2, 5.0]), "start": 0.0, "rise2": -0.9}  # nothing within the limit
    values = {Knob(WEAKER.name, "j2", name): value for name, value in share.items()}
    drive, start = random_drive(robot, 1, 150), random_start(robot, 1)
    plain, weak = (robot.replay(start, drive, rows(robot, v), ("position.j2",)) for v in ({}, values))
    np.testing.assert_allclose(weak["position.j2"], plain["position.j2"], atol=1e-12)


def test_no_law_of_the_load_turns_an_actuator_round() -> None:
    numbers = {**curve_shape([0.0, 1.0]), "start": -3.0, "rise2": 9.0}
    kind = next(e for e in HOSTED if e.name == WEAKER.name)
    assert kind.step is not None
    tau = np.array([-2.0, -0.1, 0.0, 0.1, 2.0])
    np.testing.assert_allclose(tau + kind.step(NUMPY, numbers, tau), [-4.0, 0.0, 0.0, 0.0, 4.0])


@pytest.mark.parametrize("kind", ON_BASE, ids=lambda k: k.name)
def test_a_base_moves_in_the_step_as_in_the_replay(kind: LawKind) -> None:
    values = law(kind, "yaw" if kind.of == "rate" else "left", 0.2)
    model = augment(ROVER, values, None, Build(0.02))
    u = 6.0 + 4.0 * np.sin(0.2 * np.arange(60))[:, None] * [1.0, 0.6]
    x = [model.start()]
    for now in u:
        x.append(model.numpy_step(x[-1], now))
    drive = Drive(0.02, 1, np.concatenate([u[:1], u])[None], None, np.zeros(1))
    start = {c: np.zeros(1) for c in ("pose.x", "pose.y", "pose.theta")}
    for column, channel in enumerate(start):
        nodes = ROVER.replay(start, drive, rows(ROVER, values), tuple(start))[channel][0]
        np.testing.assert_allclose(np.array(x)[:, column], nodes, atol=1e-12)
    assert np.abs(nodes - ROVER.replay(start, drive, Settings(1), tuple(start))[channel][0]).max() > 1e-3  # the heading


def test_a_law_of_the_speed_that_brakes_hard_is_stable(tmp_path: Path) -> None:
    """Stiffer than an explicit step of 2 ms could bear: 60 N m s/rad on an inertia of less than 0.02 kg m^2."""
    robot = robot_of(tmp_path, arm_xml())
    kind = next(k for k in KINDS if (k.of, k.on) == ("torque", "speed"))
    numbers = {**curve_shape([-0.5, 0.5]), "start": 30.0, "rise2": -60.0}
    values = {Knob(kind.name, "j2", name): v for name, v in numbers.items()}
    found = robot.replay(random_start(robot, 1), random_drive(robot, 1, 300), rows(robot, values), ("velocity.j2",))
    assert np.abs(found["velocity.j2"][0, 20:]).max() < 0.2
