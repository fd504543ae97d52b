"""Viscous friction in the batch: of the joints, and what a negative one takes from the servos that drive them."""

from typing import Any

import numpy as np

from plants.mujoco_robot.structure.compiled_robot import CompiledRobot
from plants.mujoco_robot.structure.servo_damping import at_joints, share_left
from residual_mpc.effects.chain import scaled
from residual_mpc.effects.library import Effects, present
from residual_mpc.effects.ops import NUMPY


def edit_damping(batch: Any, robot: CompiledRobot, effects: Effects, added: np.ndarray) -> None:
    """Add viscous friction (B, joints) to the batch. Rows without any keep their values, bit for bit."""
    dofs, field = robot.dofs, batch.expand("dof_damping")
    whole = field[:, dofs] + added
    field[:, dofs] = np.where(added < 0.0, np.maximum(whole, 0.0), whole)
    taken = np.where(added < 0.0, np.maximum(-whole, 0.0), 0.0)[:, robot.driven]
    if not taken.any():
        return
    bias = batch.expand("actuator_biasprm")
    given = at_joints(robot, np.maximum(-bias[:, :, 2], 0.0))[:, robot.driven]
    steady = [(e, p) for e, p in present(effects, "strength") if e.steady]
    strength = scaled(NUMPY, steady, np.ones_like(given), 0.0, 0.0)
    left = share_left(NUMPY, taken, given, strength)
    bias[:, :, 2] *= np.where(robot.servo & (taken > 0.0), left, 1.0)
