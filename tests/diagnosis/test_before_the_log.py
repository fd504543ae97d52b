"""What the actuators held before the first stamp, told by the first samples."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from diagnosis.linear import ROVER
from oracles.arms import arm_xml, robot_of

from residual_mpc.diagnosis.data.before_the_log import held_before
from residual_mpc.diagnosis.data.signals import Signal, Signals
from residual_mpc.logs.run import Run
from residual_mpc.models.protocol import Robot

MOTORS = '<motor name="j1" joint="j1"/><motor name="j2" joint="j2"/>'
FIRST = (2.5, -0.8)  # N m
JOINT = 0.1  # N m s/rad, damping of the first joint


def begun(late: float, seed: int, noise: float = 1e-4, gain: float = 1.0, dry: float = 0.0, load: float = 0.0) -> Run:
    """An arm at rest whose motors get their first torques `late` s after the log begins; 200 Hz, stepped at 0.1 ms.
    gain: of the motors; dry: N m of friction; load: kg at the tip."""
    spec = mujoco.MjSpec.from_string(arm_xml(MOTORS))
    spec.body("lower").add_geom(
        type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.01, 0, 0], pos=[0.0, 0.0, -0.2], mass=max(load, 1e-6), contype=0
    )
    model = spec.compile()
    model.opt.timestep = 1e-4
    model.dof_frictionloss[:] = dry
    data, rng = mujoco.MjData(model), np.random.default_rng(seed)
    data.qpos[:] = (0.4, 0.3)
    t, q = 0.005 * np.arange(220), []
    for _ in t:
        q.append(data.qpos + noise * rng.standard_normal(2))
        for _ in range(50):
            data.ctrl[:] = gain * np.array(FIRST) if data.time >= late - 1e-9 else 0.0
            mujoco.mj_step(model, data)
    columns = {f"command.j{k + 1}": np.full(len(t), u) for k, u in enumerate(FIRST)}
    return Run("r", t, columns | {f"position.j{k + 1}": np.array(q)[:, k] for k in range(2)})


def signals_of(run: Run) -> Signals:
    return Signals({(0, c): Signal(run.t, y) for c, y in run.columns.items() if not c.startswith("command.")})


def before_of(robot: Robot, run: Run) -> tuple[float | None, ...]:
    (found,) = held_before(robot, [run], [0], signals_of(run))
    return found


def test_one_run_that_tells_little_goes_with_the_others(tmp_path: Path) -> None:
    """Noise of 2 mrad hides a dead time of 15 ms in one run."""
    robot, runs = robot_of(tmp_path, arm_xml(MOTORS)), [begun(0.015, 0, noise=4e-3), begun(0.015, 1), begun(0.015, 2)]
    signals = Signals({(i, c): s for i, r in enumerate(runs) for (_, c), s in signals_of(r).items()})
    assert before_of(robot, runs[0]) == (None, None)
    assert held_before(robot, runs, range(3), signals) == [(0.0, 0.0)] * 3


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("late", "before"), [(0.0, (None, None)), (0.002, (None, None)), (0.015, (0.0, 0.0))])
def test_motors_that_gave_nothing_yet(tmp_path: Path, late: float, before: tuple[float | None, ...], seed: int) -> None:
    """A dead time of 2 ms in samples of 5 ms hardly shows, and hardly matters."""
    run = begun(late, seed)
    assert before_of(robot_of(tmp_path, arm_xml(MOTORS)), run) == before


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("unlike", [{"gain": 0.7}, {"gain": 0.5}, {"load": 0.3}, {"dry": 0.3}])
def test_a_weak_motor_a_load_or_friction_is_no_dead_time(tmp_path: Path, unlike: dict[str, float], seed: int) -> None:
    run = begun(0.0, seed, **unlike)
    assert before_of(robot_of(tmp_path, arm_xml(MOTORS)), run) == (None, None)


def test_a_weak_motor_may_have_a_dead_time_as_well(tmp_path: Path) -> None:
    run = begun(0.015, 0, gain=0.7)
    assert before_of(robot_of(tmp_path, arm_xml(MOTORS)), run) == (0.0, 0.0)


def test_a_position_servo_beside_a_motor_keeps_its_place(tmp_path: Path) -> None:
    mixed = '<motor name="j1" joint="j1"/><position name="j2" joint="j2" kp="20" kv="1"/>'
    run = begun(0.015, 0)
    held = Run("r", run.t, {**run.columns, "command.j2": np.full(len(run.t), 0.3)})
    found = before_of(robot_of(tmp_path, arm_xml(mixed)), held)
    assert found[0] == 0.0 and found[1] == pytest.approx(0.3, abs=1e-3)


@pytest.mark.parametrize("speed", [0.0, 0.4, -0.6])
def test_a_servo_in_motion_held_a_setpoint_ahead_of_it(tmp_path: Path, speed: float) -> None:
    """Ahead by what its damping takes, 1 / 20 s times the speed, where its first command lies far from where it is."""
    servos = '<position name="j1" joint="j1" kp="20" kv="1"/><position name="j2" joint="j2" kp="20" kv="1"/>'
    t = 0.01 * np.arange(40)
    moving = {"position.j1": 0.2 + speed * t, "position.j2": np.zeros(len(t))}
    run = Run("r", t, {"command.j1": 2.0 + t, "command.j2": np.zeros(len(t)), **moving})
    found = before_of(robot_of(tmp_path, arm_xml(servos)), run)
    assert found == pytest.approx((0.2 + (1.0 + JOINT) / 20.0 * speed, 0.0), abs=1e-6)


def test_positions_that_are_not_all_measured_tell_nothing(tmp_path: Path) -> None:
    run = begun(0.015, 0)
    half = Signals({(0, "position.j1"): Signal(run.t, run.columns["position.j1"])})
    assert held_before(robot_of(tmp_path, arm_xml(MOTORS)), [run], [0], half) == [(None, None)]


def rolling(left: float, right: float, noise: float = 0.0, seed: int = 0) -> Run:
    """A rover whose wheels are told to turn at 6 rad/s and turn at these speeds as the log begins. noise: m and rad."""
    t = 0.05 * np.arange(40)
    r, width = ROVER.wheel_radius, ROVER.track_width
    yaw = r * (right - left) / width * t
    forward = 0.5 * r * (left + right) * t
    rng = np.random.default_rng(seed)
    pose = {"pose.x": forward * np.cos(0.5 * yaw), "pose.y": forward * np.sin(0.5 * yaw), "pose.theta": yaw}
    pose = {c: x + noise * rng.standard_normal(len(t)) for c, x in pose.items()}
    return Run("r", t, {"command.left": np.full(40, 6.0), "command.right": np.full(40, 6.0)} | pose)


@pytest.mark.parametrize(
    ("left", "right", "before"),
    [(6.0, 6.0, (None, None)), (0.2, 0.3, (0.0, 0.0)), (1.9, 6.3, (0.0, None)), (6.0, -0.4, (None, 0.0))],
)
def test_each_wheel_stands_or_rolls(left: float, right: float, before: tuple[float | None, ...]) -> None:
    run = rolling(left, right, 1e-4)
    assert before_of(ROVER, run) == before


@pytest.mark.parametrize(("speed", "before"), [(0.0, (0.0, 0.0)), (6.0, (None, None))])
def test_noise_does_not_part_two_wheels(speed: float, before: tuple[float | None, ...]) -> None:
    """A standard error of about half the commanded speed; the sum of both wheels tells more."""
    found = [before_of(ROVER, r) for r in (rolling(speed, speed, 2e-3, seed) for seed in range(20))]
    assert found.count(before) >= 18
