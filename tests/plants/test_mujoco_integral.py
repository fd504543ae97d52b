"""The integral part of a position servo: against mj_step with an integrator of its own, from a log's history, in the
simulator and in the step of controllers."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from oracles.arms import (
    DT,
    MIXED,
    arm_xml,
    assert_rows_are_themselves,
    random_drive,
    random_start,
    robot_of,
    settings_of,
)
from oracles.own_arms import UR5E

from residual_mpc.diagnosis.data.dataset import build_dataset
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.export import Build, augment
from residual_mpc.export.moving import moving_apart
from residual_mpc.logs.run import Run
from residual_mpc.models.protocol import Drive
from residual_mpc.models.settings import Knob

PERIOD = 0.01  # s between samples


def on(joint: str | None, gain: float) -> dict[tuple[str, str | None, str], float]:
    return {("servo_integral", joint, "gain"): gain}


def summed(model: mujoco.MjModel, data: mujoco.MjData, u: np.ndarray, gain: float, x: float) -> float:
    """mj_step under commands u (nu,) with x added to that of j1; x after the step. The gear of j1 is 2."""
    data.ctrl[:] = u
    data.ctrl[0] += x
    x += gain * DT * (u[0] - 2.0 * data.qpos[0])
    mujoco.mj_step(model, data)
    return x


def test_an_integral_part_is_a_sum_of_errors(tmp_path: Path) -> None:
    """Without a past it holds the start's positions against gravity."""
    robot = robot_of(tmp_path, arm_xml())
    drive, start = random_drive(robot, 1, 150), random_start(robot, 1)
    came = robot.replay(start, drive, settings_of(robot, on("j1", 2.0)), ("position.j1",))["position.j1"][0]
    plain = robot.replay(start, drive, settings_of(robot, {}), ("position.j1",))["position.j1"][0]
    data = mujoco.MjData(robot.model)
    data.qpos[:] = [start["position.j1"][0], start["position.j2"][0]]
    mujoco.mj_forward(robot.model, data)
    x = float(data.qfrc_bias[0] - data.qfrc_passive[0]) / 2.0 / 30.0
    data.qvel[:] = [start["velocity.j1"][0], start["velocity.j2"][0]]
    for k in range(150):
        x = summed(robot.model, data, drive.command[0, drive.lead + k], 2.0, x)
        assert came[k + 1] == pytest.approx(data.qpos[0], abs=1e-12)
    assert np.abs(came - plain).max() > 1e-2


def test_rows_with_an_integral_part_are_themselves_beside_others(tmp_path: Path) -> None:
    dead, rubs = {("dead_zone", "j1", "width"): 0.05}, {("load_dependent_friction", None, "coefficient"): 0.2}
    rows = [on("j1", 2.0), {}, {**on("j2", 8.0), **dead}, rubs, {**on(None, 1.0), **rubs}]
    assert_rows_are_themselves(robot_of(tmp_path, arm_xml()), rows, 80)


def test_it_asks_for_no_more_force_than_there_is(tmp_path: Path) -> None:
    """j2 gives 3 N m; told to go where it cannot, its servo sums up no more than that, and lets go at once."""
    robot = robot_of(tmp_path, arm_xml())
    drive = random_drive(robot, 1, 3000)
    u = np.zeros_like(drive.command)
    u[:, drive.lead : drive.lead + 2000, 1] = 3.0  # j2 stops at 1.57 rad
    start = {c: np.zeros(1) for c in ("position.j1", "position.j2", "velocity.j1", "velocity.j2")}
    q = robot.replay(start, replace(drive, command=u), settings_of(robot, on("j2", 10.0)), ("position.j2",))
    assert q["position.j2"][0, 1900] > 1.5
    assert np.abs(q["position.j2"][0, 2700:]).max() < 0.3


DAMPED = """<mujoco><option timestep="0.002" integrator="implicitfast"/><worldbody><body>
  <joint name="j" axis="0 0 1"/><geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.02" mass="0.5"/>
</body></worldbody><actuator><position name="j" joint="j" kp="100" kv="20" forcerange="-5 5"/></actuator></mujoco>"""


def test_while_it_moves_it_sums_up_more_than_its_force_since_its_own_damping_takes_that(tmp_path: Path) -> None:
    """Its damping takes 20 N m at 1 rad/s, which the errors balance; its force is far below its limit of 5 N m."""
    robot, gain = robot_of(tmp_path, DAMPED), 2.0
    t = DT * np.arange(1001)
    sent = np.clip(t - 0.2, 0.0, 1.0)[:-1]
    drive = Drive(DT, 0, sent[None, :, None], None, np.zeros(1), None)
    start = {"position.j": np.zeros(1), "velocity.j": np.zeros(1)}
    settings = settings_of(robot, {("servo_integral", "j", "gain"): gain})
    came = robot.replay(start, drive, settings, ("position.j",))["position.j"]
    data, x, most, force = mujoco.MjData(robot.model), 0.0, 0.0, 0.0
    for k, u in enumerate(sent):
        assert came[0, k] == pytest.approx(data.qpos[0], abs=1e-9)
        data.ctrl[0] = u + x
        x += gain * DT * (u - data.qpos[0])
        mujoco.mj_step(robot.model, data)
        most, force = max(most, x), max(force, abs(data.actuator_force[0]))
    assert most > 2.0 * 5.0 / 100.0 and force < 2.0


def test_only_position_servos_have_one(tmp_path: Path) -> None:
    assert robot_of(tmp_path, arm_xml(MIXED)).slots("servo_integral") == ()


@pytest.mark.parametrize("settled", [True, False], ids=["settled before the run", "switched on with the run"])
def test_a_window_begins_with_what_the_log_says_was_summed_up(tmp_path: Path, settled: bool) -> None:
    """Steps of j1 by mj_step; windows in the middle of the run are foretold as well as the first."""
    robot, gain = robot_of(tmp_path, arm_xml()), 2.5
    model, every = robot.model, round(PERIOD / DT)
    data = mujoco.MjData(model)
    data.qpos[:] = [-0.4, 0.2]
    mujoco.mj_forward(model, data)
    x = float(data.qfrc_bias[0] - data.qfrc_passive[0]) / 60.0 if settled else 0.0
    t = PERIOD * np.arange(900)
    sent = np.stack([np.where((t + 0.4) % 3.0 < 1.5, -0.8, 0.6), 0.2 + 0.0 * t], axis=1)
    seen = np.empty((len(t), 2))
    for k in range(len(t)):
        seen[k] = data.qpos
        for _ in range(every):
            x = summed(model, data, sent[k], gain, x)
    names = ("command.j1", "command.j2", "position.j1", "position.j2")
    run = Run("run", t, dict(zip(names, (*sent.T, *seen.T), strict=True)))
    windows = build_dataset([run], [robot], {})
    column = windows.channels.index("position.j1")
    with_it, without = predict(windows, settings_of(robot, on("j1", gain), {}))
    miss, plain = (np.nanmax(np.abs(windows.y - p)[..., column], axis=1) for p in (with_it, without))
    assert miss.max() < (0.004 if settled else 0.012) and np.median(plain) > 0.03
    assert not np.array_equal(windows.blocks[0].drive.past.sent, np.zeros((windows.count, 2)))


@pytest.mark.parametrize("delay, lag", [(0.0, 0.08), (0.113, 0.0), (0.06, 0.05)])
def test_it_has_summed_up_what_a_delay_and_a_lag_let_through(tmp_path: Path, delay: float, lag: float) -> None:
    """Windows in the middle of a run that begins at rest: the setpoint is the command, late and low-passed."""
    robot, gain = robot_of(tmp_path, arm_xml()), 2.5
    model, every = robot.model, round(PERIOD / DT)
    data = mujoco.MjData(model)
    t = PERIOD * np.arange(900)
    later = np.maximum(t - 0.6, 0.0)
    sent = np.stack([0.6 * np.sin(1.1 * later) + 0.3 * np.sin(3.7 * later), 0.2 + 0.0 * t], axis=1)
    data.qpos[:] = [0.0, 0.2]
    mujoco.mj_forward(model, data)
    x = float(data.qfrc_bias[0] - data.qfrc_passive[0]) / 60.0
    passed, seen = sent[0].copy(), np.empty((len(t), 2))
    for k in range(len(t)):
        seen[k] = data.qpos
        for n in range(every):
            now = k * PERIOD + n * DT - delay
            late = sent[max(int(np.floor(now / PERIOD + 1e-9)), 0)]
            passed += (1.0 - np.exp(-DT / lag) if lag else 1.0) * (late - passed)
            x = summed(robot.model, data, passed, gain, x)
    names = ("command.j1", "command.j2", "position.j1", "position.j2")
    windows = build_dataset([Run("run", t, dict(zip(names, (*sent.T, *seen.T), strict=True)))], [robot], {})
    column = windows.channels.index("position.j1")
    chain = {("command_delay", None, "delay"): delay, ("actuator_lag", None, "time_constant"): lag}
    (found,) = predict(windows, settings_of(robot, {**on("j1", gain), **chain}))
    assert np.nanmax(np.abs(windows.y - found)[..., column]) < 0.004


def test_of_a_joint_that_is_not_logged_nothing_is_summed_up(tmp_path: Path) -> None:
    """Not even what a delay holds back."""
    robot = robot_of(tmp_path, arm_xml())
    t = PERIOD * np.arange(300)
    columns = {"command.j1": 1.0 + 0.0 * t, "command.j2": 0.0 * t, "position.j2": 0.1 * np.sin(t)}
    windows = build_dataset([Run("run", t, columns)], [robot], {})
    late = {**on("j1", 2.5), ("command_delay", None, "delay"): 0.1}
    drive, start = windows.blocks[0].drive, {c: np.zeros(windows.count) for c in ("position.j1", "velocity.j1")}
    start |= {"position.j2": np.zeros(windows.count), "velocity.j2": np.zeros(windows.count)}
    settings = settings_of(robot, *[late] * windows.count)
    with_it = robot.replay(start, drive, settings, ("position.j1",))["position.j1"]
    none = robot.replay(start, replace(drive, past=None), settings, ("position.j1",))["position.j1"]
    assert drive.past is not None and not drive.past.known[:, 0].any() and drive.past.known[:, 1].all()
    assert np.abs(with_it - none).max() < 0.03  # none: what holds the start's positions
    nothing = replace(drive, command=drive.command[:, : drive.lead])
    assert robot.replay(start, nothing, settings, ("position.j1",))["position.j1"].shape == (windows.count, 1)


def test_off_it_forgets(tmp_path: Path) -> None:
    robot = robot_of(tmp_path, arm_xml())
    t = PERIOD * np.arange(500)
    off = (t >= 1.2) & (t < 1.8)
    told, seen = {"command.j1": 0.5 + 0.0 * t, "command.j2": 0.0 * t}, {"position.j1": 0.1 * np.sin(t)}
    columns = {**told, **seen, "position.j2": 0.0 * t, "enabled.j1": 1.0 - off}
    windows = build_dataset([Run("run", t, columns)], [robot], {})
    past = windows.blocks[0].drive.past
    np.testing.assert_array_equal(past.whole[:, 0], [1, 1, 0, 0, 0][: windows.count])
    assert past.sent[2, 0] == pytest.approx(0.5 * 0.2, abs=0.006) and past.sent[2, 1] == 0.0
    assert past.take(np.array([2])).sent[0, 0] == past.sent[2, 0]


def test_the_simulator_and_the_step_agree(tmp_path: Path) -> None:
    values = {Knob("servo_integral", "elbow", "gain"): 3.0}
    robot = robot_of(tmp_path, UR5E)
    model = augment(robot, values, None, Build(0.02))
    assert "integral.elbow" in model.stepped.states and not model.stepped.left_out[1:]
    assert moving_apart(model, np.random.default_rng(1)) < 3e-3


def test_at_rest_the_step_stays_and_the_command_is_the_position(tmp_path: Path) -> None:
    robot = robot_of(tmp_path, UR5E)
    values = {Knob("servo_integral", None, "gain"): 3.0}
    model = augment(robot, values, None, Build(0.02))
    x = model.start()
    u = model.stepped.holding(x)
    np.testing.assert_allclose(u, x[: len(robot.joints)], atol=1e-9)
    np.testing.assert_allclose(model.numpy_step(x, u), x, atol=2e-4)


def test_an_mjcf_leaves_it_out_and_says_so(tmp_path: Path) -> None:
    robot = robot_of(tmp_path, arm_xml())
    made = robot.to_mjcf(settings_of(robot, on("j1", 2.0)), tmp_path)
    (said,) = made.left_out
    assert said.startswith("servo_integral: ") and made.apart < 1e-6 < made.apart_from_all
