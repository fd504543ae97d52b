"""A two-joint arm as MJCF and as URDF, and logs of it as a stranger would have written them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import mujoco
import numpy as np
import pandas as pd
from oracles.urdfs import arm_urdf

JOINTS = ("shoulder", "elbow")
KP, KV = (30.0, 12.0), (1.5, 0.6)
STEP, EVERY = 0.002, 5  # s, and steps a sample

URDF = arm_urdf(JOINTS, -2.5, 2.0)
SERVOS: Mapping[str, str] = {
    "position": '<position name="{j}" joint="{j}" kp="{kp}" kv="{kv}"/>',
    "velocity": '<velocity name="{j}" joint="{j}" kv="{kp}"/>',
    "motor": '<motor name="{j}" joint="{j}"/>',
}


def mjcf(kind: str = "position", joints: tuple[str, ...] = JOINTS) -> str:
    """The arm of URDF with actuators of one kind."""
    body = """<body name="{link}" pos="{at} 0 0"><inertial pos="0.1 0 0.02" mass="0.5" diaginertia="0.01 0.012 0.008"/>
      <joint name="{joint}" axis="0 1 0" range="-2.5 2" damping="0.1" frictionloss="0.02"/>{rest}</body>"""
    lower = body.format(link="lower", at=0.3, joint=joints[1], rest='<site name="tool" pos="0.2 0 0"/>')
    servos = [SERVOS[kind].format(j=j, kp=kp, kv=kv) for j, kp, kv in zip(joints, KP, KV, strict=True)]
    return f"""<mujoco model="arm"><compiler angle="radian" autolimits="true"/>
    <option integrator="implicitfast" timestep="{STEP}"/>
    <worldbody>{body.format(link="upper", at=0, joint=joints[0], rest=lower)}</worldbody>
    <actuator>{"".join(servos)}</actuator></mujoco>"""


def simulate(kind: str = "position", seconds: float = 20.0, seed: int = 0) -> pd.DataFrame:
    """A run in the log format, rad and s: steps and swings, 40 ms late, with a little noise."""
    rng = np.random.default_rng(seed)
    model = mujoco.MjModel.from_xml_string(mjcf("motor" if kind == "motor" else kind))
    data = mujoco.MjData(model)
    data.qpos[:] = data.ctrl[:] = (-0.5, 0.3) if kind == "position" else (0.0, 0.0)
    steps = int(seconds / STEP)
    t = STEP * np.arange(steps)
    command = np.stack([_course(t, k, rng) for k in range(2)], axis=1)
    late = np.concatenate([np.tile(command[:1], (20, 1)), command[:-20]])
    rows = []
    for i in range(steps):
        if i % EVERY == 0:
            sent = command[i] if kind != "motor" else _torque(model, data, late[i])
            rows.append([t[i], *sent, *data.qpos, *data.qvel])
        data.ctrl[:] = {"position": late[i], "velocity": _speed(late, i), "motor": rows[-1][1:3]}[kind]
        if kind == "velocity" and i % EVERY == 0:
            rows[-1][1:3] = _speed(command, i)
        mujoco.mj_step(model, data)
    columns = [f"{group}.{joint}" for group in ("command", "position", "velocity") for joint in JOINTS]
    table = pd.DataFrame(rows, columns=["t", *columns])
    table[columns[2:4]] += 1e-3 * rng.standard_normal((len(table), 2))
    table[columns[4:]] += 1e-2 * rng.standard_normal((len(table), 2))
    return table


def _course(t: np.ndarray, k: int, rng: np.random.Generator) -> np.ndarray:
    """(n,) rad: a few poses that are held, then swings about the last."""
    poses = np.repeat(rng.uniform(-1.2, 0.8, 8), 625)
    poses = np.concatenate([poses, np.full(max(0, len(t) - len(poses)), poses[-1])])[: len(t)]
    rates = np.array([0.7, 1.9, 3.1]) * (1.0 + 0.3 * k)
    swing = sum(0.25 * np.sin(w * t + p) for w, p in zip(rates, rng.uniform(0, 6, 3), strict=True))
    return np.asarray(poses + np.where(t > 10.0, swing, 0.0))


def _speed(course: np.ndarray, i: int) -> np.ndarray:
    """(2,) rad/s: the course's slope, its steps spread over half a second."""
    return np.asarray((course[min(i + 125, len(course) - 1)] - course[max(i - 125, 0)]) / 0.5)


def _torque(model: mujoco.MjModel, data: mujoco.MjData, wanted: np.ndarray) -> np.ndarray:
    """(2,) N m of a servo that runs in the user's own program."""
    return np.asarray(np.array(KP) * (wanted - data.qpos) - np.array(KV) * data.qvel)


def write(folder: Path, table: pd.DataFrame, name: str = "run1.csv") -> Path:
    path = folder / name
    table.to_csv(path, index=False)
    return path


VISCOUS = (60.0, 57.0, 52.0, 9.3, 56.0, 3.1)  # N m s/rad of six joints: torques that go like their speeds


def six_joint_mjcf() -> str:
    """An arm whose joints run in thick grease."""
    body = ""
    for k, (damping, axis) in enumerate(
        zip(VISCOUS, ("0 0 1", "0 1 0", "0 1 0", "1 0 0", "0 1 0", "1 0 0"), strict=True)
    ):
        body += f"""<body name="l{k}" pos="0.1 0 0.05">
        <inertial pos="0.05 0 0" mass="0.5" diaginertia="0.01 0.01 0.01"/>
        <joint name="j{k}" axis="{axis}" range="-3 3" damping="{damping}"/>"""
    servos = "".join(f'<position name="j{k}" joint="j{k}" kp="{20 * d}" kv="{d}"/>' for k, d in enumerate(VISCOUS))
    return f"""<mujoco model="six"><compiler angle="radian" autolimits="true"/>
    <option integrator="implicitfast" timestep="{STEP}"/>
    <worldbody>{body}{"</body>" * len(VISCOUS)}</worldbody><actuator>{servos}</actuator></mujoco>"""


def simulate_six_joints(seconds: float = 15.0, seed: int = 0) -> pd.DataFrame:
    """A run with the columns t, goal_position_K, position_K, velocity_K (rad/s) and torque_K (N m)."""
    rng = np.random.default_rng(seed)
    model = mujoco.MjModel.from_xml_string(six_joint_mjcf())
    data = mujoco.MjData(model)
    phases, rates = rng.uniform(0.0, 6.28, (6, 3)), rng.uniform(0.6, 4.0, (6, 3))
    rows = []
    for i in range(int(seconds / STEP)):
        data.ctrl[:] = 0.35 * np.sin(rates * i * STEP + phases).sum(axis=1)
        if i % EVERY == 0:
            rows.append([i * STEP, *data.ctrl, *data.qpos, *data.qvel, *data.qfrc_actuator])
        mujoco.mj_step(model, data)
    columns = [f"{group}_{k}" for group in ("goal_position", "position", "velocity", "torque") for k in range(6)]
    table = pd.DataFrame(rows, columns=["t", *columns])
    table[columns[6:12]] += 1e-4 * rng.standard_normal((len(table), 6))
    return table
