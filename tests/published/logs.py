"""Logs of the published robots with hidden effects, by MuJoCo at a quarter of the candidate's step and with another
integrator; delays, payloads and frictions are put in by hand, with none of the candidate's code."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
import pandas as pd
from published.robots import (
    PANDA_JOINTS,
    SO101_JOINTS,
    UR5E_JOINTS,
    WHEELS,
    panda_mjcf,
    rover_mjcf,
    so101_mjcf,
    ur5e_urdf,
)

FINE = 0.0005  # s
EVERY = 0.01  # s, a sample of the log
EPOCH = 1_764_000_000  # s
MIN_MOVE, MAX_MOVE = 0.4, 1.6  # s from set point to set point
FASTEST = 2.0  # rad/s, of an arm's set points: what such arms allow, and no step of a held command meets a torque limit


@dataclass(frozen=True)
class Case:
    """model: file name and text; hidden: effect -> its target and sizes in the logs; mended: whether the logs are in
    units that a robot file cannot express; besides: further effects that a diagnosis may name, for what the two
    simulations do differently in contacts."""

    name: str
    model: tuple[str, str]
    hidden: dict[str, tuple[str | None, dict[str, float]]]
    write: Callable[[Path], None]
    mended: bool = False
    besides: int = 0


def _spec(text: str) -> mujoco.MjSpec:
    """The model as the robot is, stepped finer; its shapes are left out."""
    spec = mujoco.MjSpec.from_string(text)
    for geom in [g for g in spec.geoms if g.type == mujoco.mjtGeom.mjGEOM_MESH]:
        spec.delete(geom)
    for mesh in list(spec.meshes):
        spec.delete(mesh)
    spec.option.timestep, spec.option.integrator = FINE, mujoco.mjtIntegrator.mjINT_IMPLICIT
    return spec


def _courses(
    t: np.ndarray, middle: Sequence[float], reach: Sequence[float], rng: np.random.Generator, fastest: float = np.inf
) -> np.ndarray:
    """(n, joints): smooth moves from set point to set point, none faster than `fastest`, with rests between, and a slow
    swing."""
    out = np.empty((len(t), len(middle)))
    for j, (centre, size) in enumerate(zip(middle, reach, strict=True)):
        knots, values = [0.0], [centre]
        while knots[-1] < t[-1]:
            there = centre + size * rng.uniform(-1, 1)
            shortest = 0.5 * np.pi * abs(there - values[-1]) / fastest
            knots += [knots[-1] + max(rng.uniform(MIN_MOVE, MAX_MOVE), shortest)]
            values += [there]
            knots += [knots[-1] + rng.uniform(0.1, 0.5)]
            values += [there]
        x = np.interp(t, knots, np.arange(len(knots)))
        k = np.minimum(x.astype(int), len(knots) - 2)
        part = 0.5 - 0.5 * np.cos(np.pi * (x - k))
        out[:, j] = np.array(values)[k] + part * (np.array(values)[k + 1] - np.array(values)[k])
        out[:, j] += 0.1 * size * np.sin(2 * np.pi * rng.uniform(0.5, 1.5) * t)
    return out


def _drive(model: mujoco.MjModel, command: np.ndarray, delay: float, start: np.ndarray) -> np.ndarray:
    """(n, nq): positions at each sample under commands (n, nu) that arrive `delay` s late and are held. The model's
    time step is a whole part of a sample's."""
    data = mujoco.MjData(model)
    data.qpos[: len(start)] = start
    steps, late = round(EVERY / model.opt.timestep), round(delay / model.opt.timestep)
    fine = np.repeat(command, steps, axis=0)
    fine = np.concatenate([np.repeat(fine[:1], late, axis=0), fine])[: len(fine)]
    out = np.empty((len(command), model.nq))
    for k in range(len(command)):
        out[k] = data.qpos
        for u in fine[k * steps : (k + 1) * steps]:
            data.ctrl[: len(u)] = u
            mujoco.mj_step(model, data)
    return out


def arm_log(
    spec: mujoco.MjSpec, joints: Sequence[str], middle: Sequence[float], reach: Sequence[float], delay: float,
    noise: float, seconds: float, seed: int,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """t (n,), command and measured position (n, joints)."""
    rng = np.random.default_rng(seed)
    t = EVERY * np.arange(round(seconds / EVERY))
    command = _courses(t, middle, reach, rng, FASTEST)
    q = _drive(spec.compile(), command, delay, np.array(middle))[:, : len(joints)]
    return t, command, q + noise * rng.standard_normal(q.shape)


# ---------------------------------------------------------------- UR5e: 40 ms of delay, 10 N m of friction at the elbow

UR5E_GAINS = ((4000.0, 400.0),) * 3 + ((1000.0, 60.0),) * 3  # of its controller, which the URDF does not know


UR5E_MIDDLE, UR5E_REACH = (0.0, -1.2, 1.3, -1.5, -1.4, 0.2), (0.7, 0.5, 0.6, 0.6, 0.6, 0.8)


def ur5e_as_it_is() -> mujoco.MjSpec:
    """The robot of the logs, but for its delay."""
    spec = _spec(ur5e_urdf())
    for joint, (kp, kv) in zip(UR5E_JOINTS, UR5E_GAINS, strict=True):
        spec.add_actuator(name=joint, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT).set_to_position(kp=kp, kv=kv)
    spec.joint("elbow_joint").frictionloss = 10.0
    return spec


def _write_ur5e(folder: Path) -> None:
    spec = ur5e_as_it_is()
    for run in range(3):
        t, command, q = arm_log(spec, UR5E_JOINTS, UR5E_MIDDLE, UR5E_REACH, 0.04, 1e-4, 20.0, run)
        table = {"timestamp": EPOCH + 100 * run + t}
        table |= {f"target_{j}": command[:, i] for i, j in enumerate(UR5E_JOINTS)}
        table |= {f"actual_{j}": q[:, i] for i, j in enumerate(UR5E_JOINTS)}
        pd.DataFrame(table).to_csv(folder / f"run{run}.csv", index=False)


# ---------------------------------------------------------------- Panda: 30 ms of delay, 1.5 kg in its hand


def _write_panda(folder: Path) -> None:
    spec = _spec(panda_mjcf())
    hand = spec.body("hand")
    load = hand.add_body(pos=(0, 0, 0.1034))
    load.explicitinertial, load.mass, load.ipos, load.inertia = True, 1.5, (0, 0, 0), (1e-6, 1e-6, 1e-6)
    middle, reach = (0.0, -0.3, 0.0, -1.8, 0.0, 1.6, 0.8), (0.6, 0.4, 0.5, 0.5, 0.6, 0.6, 0.8)
    for run in range(3):
        t, command, q = arm_log(spec, PANDA_JOINTS, middle, reach, 0.03, 5e-5, 16.0, 10 + run)
        table = {"stamp": EPOCH + 60 * run + t}
        table |= {f"q_d_{j}": command[:, i] for i, j in enumerate(PANDA_JOINTS)}
        table |= {f"q_{j}": q[:, i] for i, j in enumerate(PANDA_JOINTS)}
        pd.DataFrame(table).to_csv(folder / f"run{run}.csv", index=False)


# ---------------------------------------------------------------- SO-101, in degrees: 60 ms of delay, 0.2 kg


def _write_so101(folder: Path) -> None:
    spec = _spec(so101_mjcf())
    load = spec.body("gripper").add_body(pos=(-0.0079, -0.0002, -0.0981))
    load.explicitinertial, load.mass, load.ipos, load.inertia = True, 0.2, (0, 0, 0), (1e-7, 1e-7, 1e-7)
    middle, reach = (0.0, -0.4, 0.3, 0.4, 0.0, 0.6), (0.9, 0.6, 0.7, 0.7, 1.0, 0.5)
    for run in range(3):
        t, command, q = arm_log(spec, SO101_JOINTS, middle, reach, 0.06, 5e-4, 20.0, 20 + run)
        table = {"timestamp": t}
        table |= {f"action.{j}.pos": np.degrees(command[:, i]) for i, j in enumerate(SO101_JOINTS)}
        table |= {f"observation.state.{j}.pos": np.degrees(q[:, i]) for i, j in enumerate(SO101_JOINTS)}
        pd.DataFrame(table).to_csv(folder / f"episode_{run}.csv", index=False)


# ---------------------------------------------------------------- rover: 80 ms of delay, the receiver 0.2 m ahead


def _write_rover(folder: Path) -> None:
    model = _spec(rover_mjcf()).compile()
    for run in range(3):
        rng = np.random.default_rng(30 + run)
        t = EVERY * np.arange(round(30.0 / EVERY))
        forward, turn = _courses(t, (4.0, 0.0), (4.0, 3.0), rng).T
        command = np.stack([forward + (-1 if "left" in w else 1) * turn for w in WHEELS], axis=1)
        q = _drive(model, command, 0.08, np.zeros(0))
        w, x, y, z = q[:, 3:7].T
        theta = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
        pose = np.stack([q[:, 0] + 0.2 * np.cos(theta), q[:, 1] + 0.2 * np.sin(theta), theta], axis=1)
        pose += np.array([0.001, 0.001, 0.001]) * rng.standard_normal(pose.shape)
        table = {"stamp_ns": EPOCH * 1_000_000_000 + np.round(1e9 * t).astype(np.int64)}
        table |= {f"cmd_vel_{w}": command[:, i] for i, w in enumerate(WHEELS)}
        table |= {"x": pose[:, 0], "y": pose[:, 1], "yaw": pose[:, 2]}
        pd.DataFrame(table).iloc[::2].to_csv(folder / f"drive{run}.csv", index=False)


DELAY = "command_delay"
CASES = {
    c.name: c
    for c in (
        Case(
            "ur5e",
            ("ur5e.urdf", ur5e_urdf()),
            {DELAY: (None, {"delay": 0.04}), "coulomb_friction": ("elbow_joint", {"torque": 10.0})},
            _write_ur5e,
        ),
        Case(
            "panda",
            ("panda.xml", panda_mjcf()),
            {DELAY: (None, {"delay": 0.03}), "payload": (None, {"mass": 1.5})},
            _write_panda,
        ),
        Case(
            "so101",
            ("so101.xml", so101_mjcf()),
            {DELAY: (None, {"delay": 0.06}), "payload": (None, {"mass": 0.2})},
            _write_so101,
            mended=True,
        ),
        Case(
            "rover",
            ("rover.xml", rover_mjcf()),
            {DELAY: (None, {"delay": 0.08}), "sensor_mounting": (None, {"x": 0.2})},
            _write_rover,
        ),
    )
}
