"""Actuators that nobody commands: on no joint, such as a gripper's on a tendon, held where the model rests; on a joint
that the robot file holds, held where it starts."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from plants.mujoco_robot.structure.compiled_robot import CompiledRobot
from residual_mpc.errors import BadInput
from residual_mpc.logs.columns import did_you_mean

if TYPE_CHECKING:
    import mujoco


HOLDS = 1e3  # kg m^2 or kg of rotor: it weighs nothing on the arm, and nothing on the arm turns it
SETTLES = 0.02  # s, in which a held joint loses the speed that a noisy measurement starts it with


def held_joints(robot: CompiledRobot) -> tuple[str, ...]:
    """The joints that `hold_joints` holds."""
    rotors = robot.model.dof_armature[robot.dofs]
    return tuple(joint for joint, rotor in zip(robot.joints, rotors, strict=True) if rotor >= HOLDS)


def hold_joints(spec: "mujoco.MjSpec", names: Sequence[str], path: str) -> tuple[str, ...]:
    """Hold joints, named by themselves or by their actuators, each by a rotor too heavy to turn; the actuators that are
    gone.

    Raises BadInput for a name that is neither.
    """
    actuators = [a for a in spec.actuators if _on_joint(a)]
    of = {a.name: a.target for a in actuators} | {j.name: j.name for j in spec.joints if _turns_or_slides(j)}
    for name in names:
        if name not in of:
            raise BadInput(f"held names {name!r}, which is no joint or actuator", path, did_you_mean(name, list(of)))
    joints = {of[name] for name in names}
    for joint in joints:
        at = spec.joint(joint)
        at.armature, at.damping[0] = HOLDS, HOLDS / SETTLES
    gone = [a for a in actuators if a.target in joints]
    removed = tuple(a.name for a in gone)
    _remove(spec, gone)
    return removed


def hold_others(spec: "mujoco.MjSpec") -> tuple[str, ...]:
    """Replace what acts on no joint by what it does while nobody commands it; the names of these actuators.

    A motor gives nothing. A servo on a tendon is a spring and a damper along it, at rest where the model is at rest.
    What is neither stays as it is.
    """
    held = [a for a in spec.actuators if not _on_joint(a) and _can_be_held(a)]
    names = tuple(a.name for a in held)
    servos = [a for a in held if _acts_alone(a)]
    plain = spec.compile() if servos else None
    for servo in servos:
        _hold(spec.tendon(servo.target), servo, plain)
    _remove(spec, held)
    return names


def _remove(spec: "mujoco.MjSpec", actuators: "Sequence[mujoco.MjsActuator]") -> None:
    """Delete the actuators, and what refers to them."""
    names = {a.name for a in actuators}
    for sensor in [s for s in spec.sensors if s.objname and s.objname in names and _of_actuator(s)]:
        spec.delete(sensor)
    if actuators:
        for key in list(spec.keys):  # their commands have places for all actuators
            spec.delete(key)
    for actuator in actuators:
        spec.delete(actuator)


def _turns_or_slides(joint: "mujoco.MjsJoint") -> bool:
    import mujoco

    return bool(joint.name) and joint.type in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)


def _on_joint(actuator: "mujoco.MjsActuator") -> bool:
    import mujoco

    return bool(actuator.trntype == mujoco.mjtTrn.mjTRN_JOINT)


def _acts_alone(actuator: "mujoco.MjsActuator") -> bool:
    """Whether it gives a force without a command."""
    import mujoco

    return bool(actuator.biastype != mujoco.mjtBias.mjBIAS_NONE)


def _can_be_held(actuator: "mujoco.MjsActuator") -> bool:
    import mujoco

    if not _acts_alone(actuator):
        return bool(actuator.gaintype != mujoco.mjtGain.mjGAIN_MUSCLE)
    affine = actuator.biastype == mujoco.mjtBias.mjBIAS_AFFINE and actuator.biasprm[1] <= 0 >= actuator.biasprm[2]
    return bool(actuator.trntype == mujoco.mjtTrn.mjTRN_TENDON and affine)


def _hold(tendon: "mujoco.MjsTendon", actuator: "mujoco.MjsActuator", model: "mujoco.MjModel") -> None:
    """force = ... + b1 length + b2 speed of the actuator, gear times the tendon's; beside a spring of the tendon's own
    the two rest between them. model: compiled before."""
    stiffness, damping = (-(actuator.gear[0] ** 2) * b for b in actuator.biasprm[1:3])
    own, number = float(tendon.stiffness[0]), model.tendon(tendon.name).id
    if stiffness > 0:
        between = own * model.tendon_lengthspring[number].mean() + stiffness * model.tendon_length0[number]
        rest = float(between / (own + stiffness))
        tendon.springlength = (rest, rest)
    tendon.stiffness[0] = own + stiffness
    tendon.damping[0] += damping


def _of_actuator(sensor: "mujoco.MjsSensor") -> bool:
    import mujoco

    return bool(sensor.objtype == mujoco.mjtObj.mjOBJ_ACTUATOR)
