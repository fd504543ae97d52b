"""Effects of what surrounds the joints: springs and constant torques beside them, stops, and the base's tilt."""

from typing import Any

import numpy as np

from plants.mujoco_robot.structure.compiled_robot import CompiledRobot
from residual_mpc.effects.library import Effects, changes, elastic_line
from residual_mpc.effects.ops import NUMPY

NO_STOP = 1e6  # rad: the other end of a range that has one stop
WEAK = 1e-9  # N m/rad per N m: the stiffness of a spring that stands for a constant torque


def edit_surroundings(batch: Any, robot: CompiledRobot, effects: Effects) -> None:
    """Write springs, constant torques, stops and gravity's direction into the batch (one row a simulation)."""
    elastic = elastic_line(NUMPY, effects)
    if elastic is not None:
        _add_springs(batch, robot, *elastic)
    stops = changes(effects, "joint stop")
    if stops is not None:
        _add_stops(batch, robot, stops)
    roll, pitch = changes(effects, "gravity roll"), changes(effects, "gravity pitch")
    if roll is not None and pitch is not None:
        gravity = batch.expand("opt.gravity")
        rows = np.flatnonzero((roll[:, 0] != 0) | (pitch[:, 0] != 0))
        gravity[rows] = np.stack(tilted(robot.model.opt.gravity, roll[rows, 0], pitch[rows, 0], NUMPY), axis=-1)


def tilted(gravity: Any, roll: Any, pitch: Any, ops: Any) -> tuple[Any, Any, Any]:
    """Gravity in the frame of a base that is rolled about x, then pitched about the y axis of the ground (rad):
    (Ry(pitch) Rx(roll))^T g."""
    x, y, z = (float(g) for g in gravity)
    cr, sr, cp, sp = ops.cos(roll), ops.sin(roll), ops.cos(pitch), ops.sin(pitch)
    ahead, up = cp * x - sp * z, sp * x + cp * z
    return ahead, cr * y + sr * up, cr * up - sr * y


def is_upper(robot: CompiledRobot, joint: str, position: np.ndarray) -> np.ndarray:
    """Whether a stop at this position, rad, holds the joint from above: where it lies above the middle of the joint's
    range, or above the rest position of a joint without one."""
    low, high = robot.limits.get(joint, (None, None))
    rest = float(robot.model.qpos0[robot.places[robot.joints.index(joint)]])
    middle = rest if low is None or high is None else 0.5 * (low + high)
    return np.asarray(position > middle)


def _add_springs(batch: Any, robot: CompiledRobot, constant: np.ndarray, more: np.ndarray) -> None:
    """MuJoCo has springs, -k (q - rest); a constant torque is a weak spring whose rest position is far away."""
    at = [robot.joints.index(j) for j in robot.sites["elastic"]]
    numbers, places = robot.numbers[at], robot.places[at]
    stiffness, rest = batch.expand("jnt_stiffness"), batch.expand("qpos_spring")
    row, slot = np.nonzero((constant != 0) | (more != 0))
    own = stiffness[row, numbers[slot]]
    pull = own * rest[row, places[slot]] + constant[row, slot]
    whole = np.maximum(own + more[row, slot], WEAK * (1.0 + np.abs(pull)))
    stiffness[row, numbers[slot]], rest[row, places[slot]] = whole, pull / whole


def _add_stops(batch: Any, robot: CompiledRobot, stops: np.ndarray) -> None:
    limited, ends = batch.expand("jnt_limited"), batch.expand("jnt_range")
    for slot, joint in enumerate(robot.sites["stop"]):
        rows = np.flatnonzero(np.isfinite(stops[:, slot]))
        if not len(rows):
            continue
        number, at = robot.numbers[robot.joints.index(joint)], stops[rows, slot]
        own = robot.limits.get(joint, (-NO_STOP, NO_STOP))
        upper = is_upper(robot, joint, at)
        ends[rows, number, 0] = np.where(upper, own[0], np.maximum(at, own[0]))
        ends[rows, number, 1] = np.where(upper, np.minimum(at, own[1]), own[1])
        limited[rows, number] = True
