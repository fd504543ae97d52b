"""Small run tables that the tests of the logs share."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from residual_mpc.logs.audit import ActuatorFacts, RobotFacts
from residual_mpc.logs.run import FloatArray, Run
from residual_mpc.models.robot_file import RobotFile

ROBOT = RobotFile("rover", "diff_drive")
WHEELS = RobotFacts(
    (ActuatorFacts("left", "left", "velocity"), ActuatorFacts("right", "right", "velocity")),
    ("velocity.left", "velocity.right", "pose.x", "pose.y", "pose.theta"),
    wheel_radius=0.1,
)
JOINTS = ("a", "b", "c")
ARM = RobotFacts(
    tuple(ActuatorFacts(j, j, "position") for j in JOINTS),
    tuple(f"{kind}.{j}" for kind in ("position", "velocity") for j in JOINTS),
    limits=dict.fromkeys(JOINTS, (-2.0, 2.0)),
)


def table(rows: int = 50, dt: float = 0.02) -> dict[str, FloatArray]:
    """A wheeled robot's run by its columns, each (rows,)."""
    t = dt * np.arange(rows)
    return {
        "t": t,
        "command.left": np.sin(3.0 * t),
        "command.right": np.cos(2.0 * t),
        "pose.x": 0.1 * t,
        "pose.theta": 0.3 * np.sin(t),
    }


def write_csv(path: Path, columns: Mapping[str, FloatArray], separator: str = ",") -> Path:
    """Write columns as text, empty where a value is missing."""
    lines = [separator.join(columns)]
    for row in zip(*columns.values(), strict=True):
        lines.append(separator.join("" if np.isnan(value) else f"{value:.6f}" for value in row))
    path.write_text("\n".join(lines) + "\n")
    return path


def arm_run(rng: np.random.Generator, name: str = "run", seconds: float = 20.0, late: int = 3) -> Run:
    """Three servos that follow their own multisine a few samples late, with a little noise."""
    t = 0.02 * np.arange(int(seconds / 0.02))
    columns: dict[str, FloatArray] = {}
    for k, joint in enumerate(JOINTS):
        phases = rng.uniform(0.0, 2.0 * np.pi, 4)
        sines = [np.sin((0.9 + 0.7 * k + 1.9 * i) * t + p) / (1 + i) for i, p in enumerate(phases)]
        command = 0.5 * np.sum(sines, axis=0)
        position = np.concatenate([np.full(late, command[0]), command[:-late]])
        columns[f"command.{joint}"] = command
        columns[f"position.{joint}"] = position + 0.001 * rng.standard_normal(len(t))
        columns[f"velocity.{joint}"] = np.gradient(position, t) + 0.01 * rng.standard_normal(len(t))
    return Run(name, t, columns)


def wheel_run(rng: np.random.Generator, name: str = "run", seconds: float = 30.0) -> Run:
    """An ideal two-wheeled robot (0.1 m wheels, 0.5 m apart) on a lively path."""
    t = 0.05 * np.arange(int(seconds / 0.05))
    p, q = rng.uniform(0.0, 2.0 * np.pi, 2)
    v, w = 0.5 * np.sin(0.4 * t + p), np.sin(0.9 * t + q) + 0.5 * np.sin(2.3 * t)
    left, right = (v - 0.25 * w) / 0.1, (v + 0.25 * w) / 0.1
    theta = np.cumsum(w) * 0.05
    columns = {
        "command.left": left,
        "command.right": right,
        "velocity.left": left + 0.02 * rng.standard_normal(len(t)),
        "velocity.right": right + 0.02 * rng.standard_normal(len(t)),
        "pose.x": np.cumsum(v * np.cos(theta)) * 0.05 + 0.002 * rng.standard_normal(len(t)),
        "pose.y": np.cumsum(v * np.sin(theta)) * 0.05 + 0.002 * rng.standard_normal(len(t)),
        "pose.theta": theta + 0.004 * rng.standard_normal(len(t)),
    }
    return Run(name, t, columns)
