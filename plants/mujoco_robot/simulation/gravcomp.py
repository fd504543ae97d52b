"""A compensation of gravity in an MJCF: `gravcomp`, an upward force at the centre of mass of each body."""

from typing import TYPE_CHECKING

import numpy as np

from plants.mujoco_robot.simulation.constants import corrected_constants
from plants.mujoco_robot.simulation.gravity_compensation import unknown_weight
from plants.mujoco_robot.structure.compiled_robot import CompiledRobot
from residual_mpc.effects.library import changes
from residual_mpc.effects.surroundings import GRAVITY_COMPENSATION
from residual_mpc.models.settings import Settings

if TYPE_CHECKING:
    import mujoco

ROUNDED = 1e-12  # m: a centre of mass within it is unchanged


def why_no_gravcomp(robot: CompiledRobot, settings: Settings) -> str:
    """Why an MJCF cannot hold the compensation beside the other effects; empty where it can, or there is none."""
    name = GRAVITY_COMPENSATION.name
    if name not in settings.effects:
        return ""
    if len(np.unique(robot.driven)) < len(robot.joints):
        return "gravcomp acts on joints without a motor as well"
    new = corrected_constants(robot, settings.without(name))
    moved = np.abs(new.get("body_ipos", robot.model.body_ipos) - robot.model.body_ipos).max() > ROUNDED
    if moved or "body_pos" in new or "opt.gravity" in new:
        return "gravcomp follows the centres of mass, lengths and tilt that other effects change"
    return ""


def write_gravcomp(spec: "mujoco.MjSpec", robot: CompiledRobot, settings: Settings) -> None:
    """Write the share of each body's weight that is compensated, by the effect or by the model's own gravcomp, so that
    the compensated weight is that of the mass in the file."""
    share, model = changes(settings.effects, "compensated gravity"), robot.model
    if share is None and not unknown_weight(robot, settings).any():
        return
    borne = model.body_gravcomp if share is None else np.full(model.nbody, share[0, 0])
    mass = corrected_constants(robot, settings).get("body_mass", model.body_mass)
    for body in spec.bodies:
        if mass[body.id] > 0.0:
            body.gravcomp = float(borne[body.id] * model.body_mass[body.id] / mass[body.id])
