"""Logs of robots with a cause that no library names: a rotor that cogs or is knocked about, an arm whose supply weakens
under load, an arm behind a linkage, a rover that turns less to one side."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
from oracles.arms import DT, wheel_xml
from oracles.rover_euler import TRACK_WIDTH, WHEEL_RADIUS

from residual_mpc.logs.run import Run

ROTOR = wheel_xml('<position name="hub" joint="hub" kp="4" kv="0.3"/>')
ROTOR_FILE = 'name = "rotor"\nplant = "mujoco"\nmodel = "rotor.xml"\n'
SIGMA = 5e-4  # rad
PERIOD = 0.02  # s between samples

Torque = Callable[[float, float, float], float]  # (t s, position rad, speed rad/s) -> N m that the model lacks


def rotor_run(seed: int, torque: Torque, seconds: float = 9.0) -> Run:
    """A servo told a sum of sines, stepped by mj_step with a torque that its model lacks."""
    rng, model = np.random.default_rng(seed), mujoco.MjModel.from_xml_string(ROTOR)
    data, every = mujoco.MjData(model), round(PERIOD / DT)
    n = round(seconds / PERIOD)
    t = np.arange(n) * PERIOD
    frequency, phase = rng.uniform(0.1, 0.6, 3), rng.uniform(0.0, 6.28, 3)
    sent = 0.5 * np.sin(2 * np.pi * frequency * t[:, None] + phase).sum(axis=1)
    data.qpos[0] = sent[0]
    seen = np.empty(n)
    for k in range(n):
        seen[k] = data.qpos[0]
        data.ctrl[0] = sent[k]
        for _ in range(every):
            data.qfrc_applied[0] = torque(data.time, data.qpos[0], data.qvel[0])
            mujoco.mj_step(model, data)
    columns = {"command.hub": sent, "position.hub": seen + SIGMA * rng.standard_normal(n)}
    return Run(f"run{seed}", t, columns)


ARM = """<mujoco><option timestep="0.002" integrator="implicitfast"/><worldbody><body name="arm">
<joint name="j" type="hinge" axis="0 1 0" armature="0.0331"/><geom type="sphere" pos="0 0 -0.3" size="0.04" mass="1.1"
contype="0" conaffinity="0"/></body></worldbody>
<actuator><position name="m" joint="j" kp="6" kv="0.4" forcerange="-5 5"/></actuator></mujoco>"""
FORCE = 5.0  # N m
INERTIA, WEIGHT = 0.0331 + 1.1 * 0.3**2 + 0.4 * 1.1 * 0.04**2, 1.1 * 9.81 * 0.3  # kg m^2, N m


def weakening_run(seed: int, weakens: float, friction: float, seconds: float = 8.0, strongest: float = FORCE) -> Run:
    """An arm whose servo has 1 / (1 + weakens |current| / full current) of its voltage, the current 5 ms behind, and
    dry friction; explicit Euler steps of 0.25 ms. strongest: N m that it gives at most."""
    rng, fine = np.random.default_rng(seed), 2.5e-4
    every, n = round(0.01 / fine), round(seconds / 0.01)
    t = np.arange(n) * 0.01
    frequency, phase, size = rng.uniform(0.1, 0.7, 3), rng.uniform(0.0, 6.28, 3), rng.uniform(0.3, 0.9)
    sent = size * np.sin(2 * np.pi * frequency * t[:, None] + phase).sum(axis=1)
    q, w, current, seen = float(sent[0]), 0.0, 0.0, np.empty(n)
    for k, command in enumerate(sent.tolist()):
        seen[k] = q
        for _ in range(every):
            asked = min(max(6.0 * (command - q) - 0.4 * w, -strongest), strongest)
            given = asked / (1.0 + weakens * abs(current) / FORCE)
            current += fine / 0.005 * (asked - current)
            w += fine * (given - WEIGHT * math.sin(q) - friction * math.tanh(w / 0.02)) / INERTIA
            q += fine * w
    columns = {"command.m": sent, "position.j": seen + 3e-4 * rng.standard_normal(n)}
    return Run(f"run{seed}", t, columns)


def write_weakening(folder: Path, weakens: float, friction: float, runs: int = 6) -> Path:
    """Robot file, model and logs; the robot file."""
    from oracles.rover_log import write_run

    folder.mkdir(parents=True, exist_ok=True)
    (folder / "arm.xml").write_text(ARM)
    (folder / "robot.toml").write_text('name = "arm"\nplant = "mujoco"\nmodel = "arm.xml"\n')
    for seed in range(runs):
        write_run(weakening_run(seed, weakens, friction), folder)
    return folder / "robot.toml"


def lever(q: float) -> float:
    """The share of its modelled torque with which a linkage drives an arm."""
    return 1.0 + 0.35 * math.sin(1.9 * q + 0.6)


def linkage_run(seed: int, seconds: float = 8.0) -> Run:
    """A level arm whose servo works through a linkage; explicit Euler steps of 0.25 ms."""
    rng, fine = np.random.default_rng(seed), 2.5e-4
    every, n = round(0.01 / fine), round(seconds / 0.01)
    t = np.arange(n) * 0.01
    frequency, phase, size = rng.uniform(0.2, 1.1, 3), rng.uniform(0.0, 6.28, 3), rng.uniform(0.3, 0.5)
    sent = size * np.sin(2 * np.pi * frequency * t[:, None] + phase).sum(axis=1)
    q, w, seen = float(sent[0]), 0.0, np.empty(n)
    for k, command in enumerate(sent.tolist()):
        seen[k] = q
        for _ in range(every):
            asked = min(max(6.0 * (command - q) - 0.4 * w, -FORCE), FORCE)
            w += fine * asked * lever(q) / INERTIA
            q += fine * w
    columns = {"command.m": sent, "position.j": seen + 3e-4 * rng.standard_normal(n)}
    return Run(f"run{seed}", t, columns)


def write_linkage(folder: Path, runs: int = 6) -> Path:
    """Robot file, model and logs; the robot file."""
    from oracles.rover_log import write_run

    level = ARM.replace('axis="0 1 0"', 'axis="0 0 1"').replace('pos="0 0 -0.3"', 'pos="0.3 0 0"')
    (folder / "arm.xml").write_text(level)
    (folder / "robot.toml").write_text('name = "arm"\nplant = "mujoco"\nmodel = "arm.xml"\n')
    for seed in range(runs):
        write_run(linkage_run(seed), folder)
    return folder / "robot.toml"


def knocked(seed: int, size: float) -> Torque:
    """Bursts at times and of sizes of the run's own."""
    rng = np.random.default_rng(100 + seed)
    begins, sizes = np.sort(rng.uniform(0.0, 9.0, 11)), size * rng.standard_normal(11)
    return lambda t, q, w: float(sizes @ ((t >= begins) & (t < begins + 0.3)))


def one_sided_run(seed: int, less: float, seconds: float = 15.0) -> Run:
    """A rover that loses this share of its yaw rate in left turns."""
    fine, period = 5e-3, 0.05
    rng = np.random.default_rng(seed)
    n, every = round(seconds / fine), round(period / fine)
    t = np.arange(n) * fine
    frequency, phase = rng.uniform(0.1, 0.4, (3, 2)), rng.uniform(0.0, 6.28, (3, 2))
    wave = 6.0 + 3.0 * np.sin(2 * np.pi * frequency * t[:, None, None] + phase).sum(axis=1)
    command = np.repeat(wave[::every], every, axis=0)[:n]
    pose, rows = np.zeros(3), []
    for k in range(n):
        if k % every == 0:
            rows.append(np.concatenate([[t[k]], command[k], pose]))
        left, right = WHEEL_RADIUS * command[k]
        forward, turn = 0.5 * (left + right), (right - left) / TRACK_WIDTH
        turn = turn * (1.0 - less) if turn > 0.0 else turn
        pose = pose + fine * np.array([forward * np.cos(pose[2]), forward * np.sin(pose[2]), turn])
    log = np.array(rows)
    log[:, 3:] += rng.standard_normal((len(log), 3)) * [0.001, 0.001, 0.004]
    names = ("command.left", "command.right", "pose.x", "pose.y", "pose.theta")
    return Run(f"run{seed}", log[:, 0], dict(zip(names, log[:, 1:].T, strict=True)))


def write_rotor(folder: Path, torque: Callable[[int], Torque], runs: int = 4) -> Path:
    """Robot file, model and logs; the robot file."""
    from oracles.rover_log import write_run

    folder.mkdir(parents=True, exist_ok=True)
    (folder / "rotor.xml").write_text(ROTOR)
    (folder / "robot.toml").write_text(ROTOR_FILE)
    for seed in range(runs):
        write_run(rotor_run(seed, torque(seed)), folder)
    return folder / "robot.toml"
