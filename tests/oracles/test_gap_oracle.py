"""The measured gap against the literal one, on logs with everything that makes windows and starts awkward."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path

import mujoco
import numpy as np
import pytest
from oracles.arms import DT, robot_of, wheel_xml
from oracles.gap_literal import Reading, gap_literal, mean_held
from oracles.rover_euler import TRACK_WIDTH, WHEEL_RADIUS
from oracles.rover_log import SIGMA, rover_run

from plants.diff_drive import DiffDrive
from residual_mpc.api.gap_figures import gap_figures
from residual_mpc.diagnosis.data.dataset import build_dataset
from residual_mpc.logs.run import Run
from residual_mpc.models.model_file import read_written
from residual_mpc.models.protocol import Robot
from residual_mpc.models.robot_file import RobotFile

ROVER = DiffDrive("rover", WHEEL_RADIUS, TRACK_WIDTH)
FAULTS = {"track_width": {"scale": 1.2}, "command_delay": {"delay": 0.06}}
POSE = ("pose.x", "pose.y", "pose.theta")
HORIZON = 1.0


def rover_replay(dt: float, tau: float = 0.0) -> object:
    """The paper's equation with the heading of the middle of each step, node by node, straight between the nodes.

    tau s: the wheels' lag, settled a long time (30 tau) before the window.
    """

    def wheel_speed(run: Run, wheel: str, t0: float) -> list[float]:
        steps = math.ceil(HORIZON / dt - 1e-9)
        before = math.ceil(30 * tau / dt)
        sent = [mean_held(run, f"command.{wheel}", t0 + k * dt, t0 + (k + 1) * dt) for k in range(-before, steps)]
        if not tau:
            return sent
        y, out = sent[0], []
        for u in sent:
            end = u + (y - u) * math.exp(-dt / tau)
            out.append(u + tau / dt * (y - end))  # the mean of the exponential over the step
            y = end
        return out[before:]

    def replay(run: Run, start: Mapping[str, float], t0: float) -> Reading:
        nodes = [[start[c] for c in POSE]]
        for left, right in zip(wheel_speed(run, "left", t0), wheel_speed(run, "right", t0), strict=True):
            v, omega = WHEEL_RADIUS * (left + right) / 2, WHEEL_RADIUS * (right - left) / TRACK_WIDTH
            x, y, theta = nodes[-1]
            middle = theta + omega * dt / 2
            nodes.append([x + v * math.cos(middle) * dt, y + v * math.sin(middle) * dt, theta + omega * dt])

        def reading(channel: str, t: float) -> float:
            i = POSE.index(channel)
            k = min(max(math.floor((t - t0) / dt), 0), len(nodes) - 2)
            return nodes[k][i] + ((t - t0) / dt - k) * (nodes[k + 1][i] - nodes[k][i])

        return reading

    return replay


def wheel_replay(model: mujoco.MjModel) -> object:
    def replay(run: Run, start: Mapping[str, float], t0: float) -> Reading:
        data = mujoco.MjData(model)
        data.qpos[0], data.qvel[0] = start["position.hub"], start["velocity.hub"]
        nodes = [(data.qpos[0], data.qvel[0])]
        for k in range(round(HORIZON / DT)):
            data.ctrl[0] = mean_held(run, "command.hub", t0 + k * DT, t0 + (k + 1) * DT)
            mujoco.mj_step(model, data)
            nodes.append((data.qpos[0], data.qvel[0]))

        def reading(channel: str, t: float) -> float:
            i = 0 if channel == "position.hub" else 1
            k = min(max(math.floor((t - t0) / DT), 0), len(nodes) - 2)
            return nodes[k][i] + ((t - t0) / DT - k) * (nodes[k + 1][i] - nodes[k][i])

        return reading

    return replay


def compare(runs: list[Run], robot: Robot, replay: object, noise: dict[str, float]) -> dict[str, object]:
    """Both gaps of the runs; returns the literal one."""
    file = RobotFile("robot", "any", noise=noise)
    came = gap_figures(runs, [robot] * len(runs), file, HORIZON, None, None, 0)
    data = build_dataset(runs, [robot] * len(runs), noise, HORIZON)
    sigma = dict(zip(data.channels, data.sigma.tolist(), strict=True))
    step = dict(zip(data.channels, data.steps.tolist(), strict=True))
    states = [(s.position, s.velocity) for s in robot.states]
    wanted = gap_literal(runs, data.channels, states, replay, HORIZON, sigma, step)  # type: ignore[arg-type]
    assert came["nominal"] == pytest.approx(wanted["gap"], rel=1e-9)
    assert (came["windows"], came["skipped"]) == (wanted["windows"], wanted["skipped"])
    assert sorted(came["still"]) == wanted["still"]
    channels = {c: v["nominal"] for c, v in came["channels"].items()}
    assert channels == pytest.approx(wanted["channels"], rel=1e-9)
    return wanted


def period_of(runs: list[Run]) -> float:
    return float(np.clip(min(r.period for r in runs) / 4.0, 0.004, 0.01))


def damaged(run: Run, seed: int) -> Run:
    """A tenth of each channel's samples missing, half a second of the localisation gone, wrapped headings."""
    rng, columns = np.random.default_rng(seed), dict(run.columns)
    for c in columns:
        values = columns[c].copy()
        values[1:][rng.random(len(values) - 1) < 0.1] = np.nan
        if c in POSE:
            values[(run.t > 2.7) & (run.t < 3.3)] = np.nan  # the window that starts at 3 s has no sample near
        if c == "pose.theta":
            values = (values - 0.1) % (2 * np.pi) + 0.1  # a branch that the rover crosses
        columns[c] = values
    return Run(run.name, run.t, columns)


def test_a_regular_log() -> None:
    wanted = compare([rover_run("one", FAULTS, 6.0, seed=1)], ROVER, rover_replay(0.01), SIGMA)
    assert wanted["windows"] == 6 and wanted["gap"] > 0.1


def test_irregular_stamps_missing_samples_several_runs_and_wrapped_headings() -> None:
    runs = [
        damaged(rover_run("one", FAULTS, 6.4, 20.0, seed=1, jitter=0.8), 1),
        damaged(rover_run("two", FAULTS, 4.97, 31.0, seed=2, jitter=0.5), 2),
        rover_run("three", FAULTS, 0.7, 20.0, seed=3),  # shorter than the horizon: one window
    ]
    assert np.abs(np.diff(runs[0].columns["pose.theta"][~np.isnan(runs[0].columns["pose.theta"])])).max() > 3
    wanted = compare(runs, ROVER, rover_replay(period_of(runs)), SIGMA)
    assert wanted["skipped"] == 2


def test_a_still_channel_is_listed_and_left_out() -> None:
    run = rover_run("one", {}, 5.0, seed=4)
    columns = {**run.columns, "command.right": run.columns["command.left"]}  # straight on, so y stands still
    noise, rng = {**SIGMA, "pose.theta": 0.05}, np.random.default_rng(0)
    columns["pose.theta"] = 0.01 * rng.standard_normal(len(run.t))
    wanted = compare([Run("one", run.t, columns)], ROVER, rover_replay(0.01), noise)
    assert wanted["still"] == ["pose.theta"]


def test_encoders_are_not_compared_beside_a_pose() -> None:
    run = rover_run("one", FAULTS, 4.0, seed=5)
    encoders = {f"velocity.{w}": run.columns[f"command.{w}"] for w in ("left", "right")}
    alone = compare([run], ROVER, rover_replay(0.01), SIGMA)
    beside = compare([Run("one", run.t, {**run.columns, **encoders})], ROVER, rover_replay(0.01), SIGMA)
    assert set(beside["channels"]) == set(POSE) and beside["gap"] == alone["gap"]  # type: ignore[call-overload]


def wheel_run(name: str, seed: int, measured: tuple[str, ...], seconds: float = 4.3) -> Run:
    """A wheel with friction under a random torque, in semi-implicit Euler; irregular stamps, missing commands."""
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.uniform(0.006, 0.014, int(seconds / 0.01)))
    torque = np.repeat(0.05 * rng.standard_normal(len(t) // 20 + 1), 20)[: len(t)]
    q, v, out = 0.0, 0.5, np.empty((len(t), 2))
    for k in range(len(t)):
        out[k] = q, v
        h = (t[k + 1] - t[k]) if k + 1 < len(t) else 0.0
        v += h * (torque[k] - 0.03 * v) / 0.02
        q += h * v
    torque[7::9] = torque[6::9][: len(torque[7::9])]
    command = torque.copy()
    command[7::9] = np.nan  # held
    noisy = out + rng.standard_normal(out.shape) * (1e-3, 1e-2)
    channels = {"position.hub": noisy[:, 0], "velocity.hub": noisy[:, 1]}
    return Run(name, t, {"command.hub": command, **{c: channels[c] for c in measured}})


@pytest.mark.parametrize("measured", [("position.hub",), ("position.hub", "velocity.hub"), ("velocity.hub",)])
def test_speeds_from_the_log_or_else_from_the_positions(tmp_path: Path, measured: tuple[str, ...]) -> None:
    robot = robot_of(tmp_path, wheel_xml())
    runs = [wheel_run("one", 1, measured), wheel_run("two", 2, measured, 2.4)]
    noise = {"position.hub": 1e-3, "velocity.hub": 1e-2}
    wanted = compare(runs, robot, wheel_replay(robot.model), noise)
    assert set(wanted["channels"]) == {measured[0]}  # type: ignore[call-overload]


def test_each_run_has_its_own_sensors(tmp_path: Path) -> None:
    """A run that measures speeds alone is compared by them, beside one with positions."""
    robot = robot_of(tmp_path, wheel_xml())
    runs = [wheel_run("one", 1, ("position.hub", "velocity.hub")), wheel_run("two", 2, ("velocity.hub",))]
    noise = {"position.hub": 1e-3, "velocity.hub": 1e-2}
    wanted = compare(runs, robot, wheel_replay(robot.model), noise)
    assert set(wanted["channels"]) == {"position.hub", "velocity.hub"}  # type: ignore[call-overload]


def test_a_model_with_memory_is_warmed_up_before_the_window(tmp_path: Path) -> None:
    """`model` against the literal gap of a lagging rover; before the first stamp the first command was held."""
    runs = [damaged(rover_run("one", FAULTS, 5.4, 20.0, seed=6, jitter=0.8), 1), rover_run("two", FAULTS, 3.0, seed=7)]
    tau, dt = 0.05, period_of(runs)
    value = {"effect": "actuator_lag", "target": None, "parameter": "time_constant", "value": tau}
    path = tmp_path / "model.json"
    path.write_text(json.dumps({"schema": "residual-mpc/model/1", "robot": "rover", "values": [value]}))
    came = gap_figures(runs, [ROVER] * 2, RobotFile("robot", "any", noise=SIGMA), HORIZON, read_written(path), None, 0)
    states = [(c, None) for c in POSE]
    still = dict.fromkeys(POSE, 0.0)
    for key, lag in (("nominal", 0.0), ("model", tau)):
        wanted = gap_literal(runs, POSE, states, rover_replay(dt, lag), HORIZON, SIGMA, still)  # type: ignore[arg-type]
        assert came[key] == pytest.approx(wanted["gap"], rel=1e-9)
    assert came["model"] < 0.9 * came["nominal"]
