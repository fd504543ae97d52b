"""The constants of a corrected model: one row of the diagnosis' batch, where they differ from the compiled model's."""

import numpy as np

from plants.mujoco_robot.edits.batch import edit_batch
from plants.mujoco_robot.simulation.between import between_steps
from plants.mujoco_robot.structure.compiled_robot import CompiledRobot
from residual_mpc.models.protocol import Drive
from residual_mpc.models.settings import Settings

HELD_AS_NUMBERS = (  # fields of the compiled model that a specification keeps as well
    "dof_damping", "dof_armature", "dof_frictionloss", "dof_solimp",
    "actuator_gainprm", "actuator_biasprm", "actuator_forcerange",
    "body_mass", "body_ipos", "body_inertia", "body_iquat", "body_pos",
    "jnt_stiffness", "qpos_spring", "jnt_limited", "jnt_range",
)  # fmt: skip


def corrected_constants(robot: CompiledRobot, settings: Settings) -> dict[str, np.ndarray]:
    """Field of the model -> its values under the settings (one row), for the fields that differ."""
    from mujoco.batch import Batch

    model, nu = robot.model, robot.model.nu
    batch = Batch(model, 1, nthread=1)
    edit_batch(batch, robot, settings)
    drive = Drive(robot.step, 0, np.zeros((1, 0, nu)), None, np.zeros(1), None)
    for update in between_steps(batch, robot, settings, drive):
        update(0, np.zeros((1, len(robot.joints))), np.zeros((1, nu)))
    changed: dict[str, np.ndarray] = {}
    for field in HELD_AS_NUMBERS:
        value = np.asarray(batch.expand(field))[0]
        if not np.array_equal(value, getattr(model, field)):
            changed[field] = value.copy()
    gravity = np.asarray(batch.expand("opt.gravity"))[0]
    if not np.array_equal(gravity, model.opt.gravity):
        changed["opt.gravity"] = gravity.copy()
    return changed
