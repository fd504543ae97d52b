"""Ranges of the actuators' forces where the robot's limit is higher than the model's."""

from typing import Any

import numpy as np

from plants.mujoco_robot.structure.force_limits import NO_LIMIT
from residual_mpc.effects.chain import limits_of
from residual_mpc.effects.library import Effects
from residual_mpc.effects.ops import NUMPY, Ops


def raise_factor(ops: Ops, own: Any, limit: Any) -> Any:
    """The factor on a range of forces whose larger end is `own`, N m or N, for an effect's limit, which is at least 0.5
    NO_LIMIT where there is none; 1 where the limit is lower, and where the model sets none."""
    limited = (own > 0.0) & (own < 0.5 * NO_LIMIT)
    ratio = ops.maximum(limit / ops.where(limited, own, 1.0), 1.0)
    return ops.where(limited, ops.where(limit < 0.5 * NO_LIMIT, ratio, 1.0), 1.0)


def raised(ranges: np.ndarray, effects: Effects) -> np.ndarray:
    """(B, nu, 2) N m or N: the model's ranges of forces, with the same shape but wider where an effect's limit lies
    beyond them."""
    limits = limits_of(effects)
    if limits is None:
        return ranges
    most = np.minimum(limits[1], NO_LIMIT)
    return np.asarray(ranges * raise_factor(NUMPY, np.abs(ranges).max(axis=2), most)[:, :, None])
