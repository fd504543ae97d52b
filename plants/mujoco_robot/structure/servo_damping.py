"""The damping that position servos give the joints that they drive, and what friction below zero leaves of it.

A joint whose motor damps less than the model says has a viscous friction below that of the bearings. What a negative
coefficient takes beyond the joint's own damping comes off the servos' velocity gains, so that a motor at its limit or
switched off does not push.
"""

from typing import Any

import numpy as np

from plants.mujoco_robot.structure.compiled_robot import CompiledRobot
from residual_mpc.effects.ops import Array, Ops

TINY = 1e-12


def servo_damping(robot: CompiledRobot) -> np.ndarray:
    """(joints,) N m s/rad (N s/m where a joint slides), 0 where no position servo drives the joint."""
    return at_joints(robot, np.maximum(-robot.model.actuator_biasprm[:, 2], 0.0))


def at_joints(robot: CompiledRobot, velocity_gains: np.ndarray) -> np.ndarray:
    """(..., joints) the damping that position servos with velocity gains (..., nu) give their joints."""
    found = np.zeros((*velocity_gains.shape[:-1], len(robot.joints)))
    own = np.where(robot.servo, velocity_gains, 0.0) * robot.model.actuator_gear[:, 0] ** 2
    for i, joint in enumerate(robot.driven.tolist()):
        found[..., joint] += own[..., i]
    return found


def share_left(ops: Ops, taken: Array, damping: Array, strength: Array) -> Array:
    """The share of a servo's velocity gain that is left where `taken` is missing of the damping that the servos give
    their joint. strength: the factor by which the servo's force is scaled afterwards."""
    lost: Any = taken / ops.maximum(strength * damping, TINY)
    return 1.0 - ops.minimum(lost, 1.0)
