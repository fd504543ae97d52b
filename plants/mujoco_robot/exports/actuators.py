"""What drives each joint of a corrected robot, as numbers at the joint."""

import numpy as np

from plants.mujoco_robot.mjcf import not_held, settled
from plants.mujoco_robot.simulation.constants import corrected_constants
from plants.mujoco_robot.structure.compiled_robot import CompiledRobot
from plants.mujoco_robot.structure.force_limits import NO_LIMIT
from residual_mpc.effects.effect import Effect
from residual_mpc.effects.library import BY_NAME, changes
from residual_mpc.models.actuator_values import ActuatorValues
from residual_mpc.models.settings import Settings

OF_ACTUATORS = {  # sites of effects
    "command", "strength", "position gain", "limit", "dry friction", "friction", "damping", "rotor",
}  # fmt: skip


def actuator_values(robot: CompiledRobot, settings: Settings) -> tuple[ActuatorValues, ...]:
    """See ListsActuators."""
    said = settled(
        Settings(1, {e: p for e, p in settings.effects.items() if _of_actuators(BY_NAME[e])}, settings.tuned)
    )
    model, new = robot.model, corrected_constants(robot, said)

    def value(field: str) -> np.ndarray:
        return np.asarray(new.get(field, getattr(model, field)))

    gear = model.actuator_gear[:, 0]
    bias, gain, reach = (value(f"actuator_{f}") for f in ("biasprm", "gainprm", "forcerange"))
    found = (changes(said.effects, q) for q in ("command delay", "command lag"))
    delay, lag = (np.zeros(model.nu) if x is None else np.maximum(x[0], 0.0) for x in found)
    out = []
    for i, (name, joint, kind) in enumerate(
        zip(robot.actuators, robot.actuator_joints, robot.command_kinds, strict=True)
    ):
        number, dof = int(model.actuator_trnid[i, 0]), int(robot.dofs[robot.driven[i]])
        limits = [float(np.abs(reach[i]).max() * abs(gear[i]))]
        if model.jnt_actfrclimited[number]:
            limits.append(float(np.abs(model.jnt_actfrcrange[number]).max()))
        limit = min(limits)
        out.append(ActuatorValues(
            actuator=name, joint=joint, kind=kind, gear=float(gear[i]),
            stiffness=float((0.0 - bias[i, 1]) * gear[i] ** 2),  # -0.0 would be written for a motor without a servo
            damping=float((0.0 - bias[i, 2]) * gear[i] ** 2),
            armature=float(value("dof_armature")[dof]),
            friction=float(value("dof_frictionloss")[dof]),
            viscous_friction=float(np.atleast_1d(value("dof_damping")[dof])[0]),
            effort_limit=limit if limit < 0.5 * NO_LIMIT * abs(gear[i]) else None,
            delay=float(delay[i]), lag=float(lag[i]), gain=float(gain[i, 0] * gear[i]),
        ))  # fmt: skip
    return tuple(out)


def not_of_actuators(settings: Settings) -> tuple[str, ...]:
    """The effects that are no value of an actuator, each with where it belongs."""
    left = [BY_NAME[e] for e in settings.effects if not _of_actuators(BY_NAME[e])]
    out = [f"{e.name}: {not_held(e) or 'no value of an actuator; export to mjcf or urdf'}" for e in left]
    return (*out, *(f"{k}: no value of an actuator" for k in settings.tuned if k.startswith("body.")))


def _of_actuators(effect: Effect) -> bool:
    """Whether an effect is a value of an actuator, or of the joint that it drives."""
    return effect.place in OF_ACTUATORS and not not_held(effect)
