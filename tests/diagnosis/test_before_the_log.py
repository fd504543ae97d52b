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

MOTORS = '<motor name="j1" joint="j1"/><motor name="j2" joint="j2"/>'
FIRST = (2.5, -0.8)  # N m


def begun(late: float, seed: int, noise: float = 1e-4) -> Run:
    """An arm at rest whose motors get their first torques `late` s after the log begins; 200 Hz, stepped at 0.1 ms."""
    model = mujoco.MjModel.from_xml_string(arm_xml(MOTORS))
    model.opt.timestep = 1e-4
    data, rng = mujoco.MjData(model), np.random.default_rng(seed)
    data.qpos[:] = (0.4, 0.3)
    t, q = 0.005 * np.arange(220), []
    for _ in t:
        q.append(data.qpos + noise * rng.standard_normal(2))
        for _ in range(50):
            data.ctrl[:] = FIRST if data.time >= late - 1e-9 else (0.0, 0.0)
            mujoco.mj_step(model, data)
    columns = {f"command.j{k + 1}": np.full(len(t), u) for k, u in enumerate(FIRST)}
    return Run("r", t, columns | {f"position.j{k + 1}": np.array(q)[:, k] for k in range(2)})


def signals_of(run: Run) -> Signals:
    return Signals({(0, c): Signal(run.t, y) for c, y in run.columns.items() if not c.startswith("command.")})


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("late", "before"), [(0.0, (None, None)), (0.002, (None, None)), (0.015, (0.0, 0.0))])
def test_motors_that_gave_nothing_yet(tmp_path: Path, late: float, before: tuple[float | None, ...], seed: int) -> None:
    """A dead time of 2 ms in samples of 5 ms hardly shows, and hardly matters."""
    run = begun(late, seed)
    assert held_before(robot_of(tmp_path, arm_xml(MOTORS)), run, 0, signals_of(run)) == before


def test_positions_that_are_not_all_measured_tell_nothing(tmp_path: Path) -> None:
    run = begun(0.015, 0)
    half = Signals({(0, "position.j1"): Signal(run.t, run.columns["position.j1"])})
    assert held_before(robot_of(tmp_path, arm_xml(MOTORS)), run, 0, half) == (None, None)


def rolling(left: float, right: float) -> Run:
    """A rover whose wheels are told to turn at 6 rad/s and turn at these speeds as the log begins."""
    t = 0.05 * np.arange(40)
    r, width = ROVER.wheel_radius, ROVER.track_width
    yaw = r * (right - left) / width * t
    forward = 0.5 * r * (left + right) * t
    columns = {"command.left": np.full(40, 6.0), "command.right": np.full(40, 6.0)}
    pose = {"pose.x": forward * np.cos(0.5 * yaw), "pose.y": forward * np.sin(0.5 * yaw), "pose.theta": yaw}
    return Run("r", t, columns | pose)


@pytest.mark.parametrize(
    ("left", "right", "before"),
    [(6.0, 6.0, (None, None)), (0.2, 0.3, (0.0, 0.0)), (1.9, 6.3, (0.0, None)), (6.0, -0.4, (None, 0.0))],
)
def test_each_wheel_stands_or_rolls(left: float, right: float, before: tuple[float | None, ...]) -> None:
    run = rolling(left, right)
    assert held_before(ROVER, run, 0, signals_of(run)) == before


def test_wheels_of_half_their_speed_are_judged_together() -> None:
    run = rolling(2.9, 0.5)
    assert held_before(ROVER, run, 0, signals_of(run)) == (0.0, 0.0)
    run = rolling(3.1, 5.5)
    assert held_before(ROVER, run, 0, signals_of(run)) == (None, None)
