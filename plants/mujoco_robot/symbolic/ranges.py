"""Ranges of an arm's commands, joints and actuator forces, and its home position."""

import numpy as np

from plants.mujoco_robot.structure.compiled_robot import CompiledRobot

MOST = 1e3  # command units, for a motor without limits


def reach(robot: CompiledRobot, force: np.ndarray) -> tuple[tuple[float, float], ...]:
    """(nu,) pairs of the lowest and highest command: the actuator's range, else what a motor's largest force (nu,), N m
    or N, takes, else half a turn to either side."""
    out = []
    for i, name in enumerate(robot.actuators):
        if name in robot.command_limits:
            out.append(robot.command_limits[name])
            continue
        gear, gain = (float(abs(x)) for x in (robot.model.actuator_gear[i, 0], robot.model.actuator_gainprm[i, 0]))
        if robot.command_kinds[i] == "torque":
            most = min(float(force[i]) / max(gain, 1e-12), MOST)
            out.append((-most, most))
        else:
            out.append((-np.pi * gear, np.pi * gear))
    return tuple(out)


def home(robot: CompiledRobot) -> dict[str, float]:
    """Position channel -> rad or m: the first keyframe, else qpos0; the middle of the range if that is outside."""
    model, out = robot.model, {}
    drawn = model.key_qpos[0] if model.nkey else model.qpos0
    for joint, place in zip(robot.joints, robot.places.tolist(), strict=True):
        low, high = robot.limits.get(joint, (-np.inf, np.inf))
        at = float(drawn[place])
        out[f"position.{joint}"] = at if low <= at <= high else 0.5 * (low + high)
    return out


def span(robot: CompiledRobot, joint: str) -> tuple[float, float]:
    """A joint's range, rad or m; half a turn to either side if it has none."""
    at = robot.rest[f"position.{joint}"]
    return robot.limits.get(joint, (at - np.pi, at + np.pi))
