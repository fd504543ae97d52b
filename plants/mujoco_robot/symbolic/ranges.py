"""What an arm's commands, joints and actuators can reach, and where it is at home."""

import numpy as np

from plants.mujoco_robot.loading.compile import NO_LIMIT
from plants.mujoco_robot.structure.compiled_robot import CompiledRobot

MOST = 1e3  # command units, of a motor that nothing limits


def reach(robot: CompiledRobot) -> tuple[tuple[float, float], ...]:
    """(nu,) pairs of the lowest and highest command: the actuator's own, of a motor without one its force's."""
    out = []
    for i, name in enumerate(robot.actuators):
        if name in robot.command_limits:
            out.append(robot.command_limits[name])
            continue
        gear, gain = (float(abs(x)) for x in (robot.model.actuator_gear[i, 0], robot.model.actuator_gainprm[i, 0]))
        if robot.servo[i]:
            out.append((-np.pi * gear, np.pi * gear))
        elif robot.command_kinds[i] == "torque":
            most = min(float(np.abs(robot.model.actuator_forcerange[i]).max()) / max(gain, 1e-12), MOST)
            out.append((-most, most))
        else:
            out.append((-np.pi * gear, np.pi * gear))
    return tuple(out)


def strength(robot: CompiledRobot, i: int) -> float:
    """N m (N), the largest force that the model lets an actuator give; inf where it sets none."""
    most = float(np.abs(robot.model.actuator_forcerange[i]).max())
    return most if most < 0.5 * NO_LIMIT else float("inf")


def home(robot: CompiledRobot) -> dict[str, float]:
    """Position channel -> rad or m: the model's first keyframe, else as it is drawn, within the joints' ranges."""
    model, out = robot.model, {}
    drawn = model.key_qpos[0] if model.nkey else model.qpos0
    for joint, place in zip(robot.joints, robot.places.tolist(), strict=True):
        low, high = robot.limits.get(joint, (-np.inf, np.inf))
        at = float(drawn[place])
        out[f"position.{joint}"] = at if low <= at <= high else 0.5 * (low + high)
    return out


def span(robot: CompiledRobot, joint: str) -> tuple[float, float]:
    """A joint's range, rad or m; half a turn to either side where it has none."""
    at = robot.rest[f"position.{joint}"]
    return robot.limits.get(joint, (at - np.pi, at + np.pi))
