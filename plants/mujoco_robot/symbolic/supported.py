"""Check whether a MuJoCo model has a step in CasADi: rigid bodies on a fixed base, actuated joint by joint."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from plants.mujoco_robot.structure.compiled_robot import CompiledRobot
from residual_mpc.errors import BadInput

if TYPE_CHECKING:
    import mujoco

NO_CONTACTS = "contacts and joint stops: in the step, bodies pass through each other and joints exceed their ranges"


def refuse_without_step(robot: CompiledRobot) -> None:
    """Raises BadInput with the first reason if the step cannot express the robot's dynamics."""
    fault = next(_faults(robot), None)
    if fault:
        raise BadInput(
            f"{robot.name!r} has no step in CasADi: {fault}",
            robot.name,
            "remove this from the model for MPC, LQR and export; diagnosis and simulation work as it is",
        )


def left_out(model: "mujoco.MjModel") -> tuple[str, ...]:
    """Parts of the model that the step leaves out, as sentences."""
    collides = ((model.geom_contype != 0) | (model.geom_conaffinity != 0)).any()
    return (NO_CONTACTS,) if collides or model.jnt_limited.any() else ()


def _faults(robot: CompiledRobot) -> Iterator[str]:
    model = robot.model
    if robot.base is not None:
        yield f"its base (pose_body {model.body(robot.base.body).name!r}) drives on contacts, which the step leaves out"
    if robot.settings:
        yield "its variants use several models"
    if model.neq:
        yield "it has equality constraints (closed chains or coupled joints)"
    if _pulling_tendons(model):
        yield "it has tendons that exert forces"
    if len(robot.joints) != model.nv:
        yield "it has joints other than hinges and slides"
    yield from _actuator_faults(model)
    yield from _passive_faults(model)


def _pulling_tendons(model: "mujoco.MjModel") -> bool:
    fields = ("stiffness", "damping", "frictionloss", "limited", "armature")
    return any(np.any(getattr(model, f"tendon_{f}")) for f in fields) if model.ntendon else False


def _actuator_faults(model: "mujoco.MjModel") -> Iterator[str]:
    import mujoco

    for i in range(model.nu):
        name = model.actuator(i).name
        if int(model.actuator_dyntype[i]) != int(mujoco.mjtDyn.mjDYN_NONE) or model.actuator_delay[i] > 0:
            yield f"actuator {name!r} has dynamics or a delay of its own (give them as effects in a model file)"
        affine = int(model.actuator_gaintype[i]) == int(mujoco.mjtGain.mjGAIN_FIXED) and int(
            model.actuator_biastype[i]
        ) in (int(mujoco.mjtBias.mjBIAS_NONE), int(mujoco.mjtBias.mjBIAS_AFFINE))
        if not affine:
            yield f"actuator {name!r} is neither a motor nor a position or velocity servo"
        if model.actuator_damping[i] or model.actuator_armature[i]:
            yield f"actuator {name!r} has damping or armature of its own (give them at its joint)"


def _passive_faults(model: "mujoco.MjModel") -> Iterator[str]:
    for field in ("dof_dampingpoly", "jnt_stiffnesspoly"):
        if np.any(getattr(model, field)):
            yield f"its springs or dampers are not linear ({field})"
    if model.body_gravcomp.any():
        yield "it uses gravcomp, which compensates gravity without an actuator"
    if model.opt.density or model.opt.viscosity or np.any(model.opt.wind):
        yield "it moves in a fluid"
