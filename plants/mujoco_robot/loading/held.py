"""Actuators that act on no joint, such as a gripper's on a tendon: held where the model rests."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import mujoco


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
    for sensor in [s for s in spec.sensors if s.objname and s.objname in names and _of_actuator(s)]:
        spec.delete(sensor)
    if held:
        for key in list(spec.keys):  # their commands have places for all actuators
            spec.delete(key)
    for actuator in held:
        spec.delete(actuator)
    return names


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
