"""Ranges of the actuators' forces where the robot's limit is higher than the model's."""

from typing import Any

import numpy as np

from plants.mujoco_robot.structure.force_limits import NO_LIMIT
from residual_mpc.effects.chain import limits_of
from residual_mpc.effects.library import Effects
from residual_mpc.effects.ops import Ops


def raised(ranges: np.ndarray, effects: Effects) -> np.ndarray:
    """(B, nu, 2) N m or N: the model's ranges of forces, with the same shape but wider where an effect's limit lies
    beyond them."""
    limits = limits_of(effects)
    if limits is None:
        return ranges
    own, high = np.abs(ranges).max(axis=2), limits[1]
    with np.errstate(divide="ignore", invalid="ignore"):
        times = np.where((own > 0.0) & (own < 0.5 * NO_LIMIT) & np.isfinite(high), np.maximum(high / own, 1.0), 1.0)
    return np.asarray(ranges * times[:, :, None])


def raised_by(ops: Ops, own: float, limit: Any) -> Any:
    """The factor on a range whose larger end is `own`, for one limit, which is at least 0.5 NO_LIMIT where there is
    none."""
    if not 0.0 < own < 0.5 * NO_LIMIT:
        return 1.0
    return ops.where(limit < 0.5 * NO_LIMIT, ops.maximum(limit / own, 1.0), 1.0)
