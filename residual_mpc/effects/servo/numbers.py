"""The numbers that describe a servo: what each is called, and which parameter of which effect says it."""

from dataclasses import dataclass
from typing import Literal

from residual_mpc.effects.actuator import (
    ACTUATOR_GAIN,
    ACTUATOR_LAG,
    BACKLASH,
    RATE_LIMIT,
    SATURATION,
    TORQUE_SPEED_LIMIT,
    VOLTAGE_SAG,
)
from residual_mpc.effects.body import (
    ARMATURE,
    COULOMB,
    GEAR_EFFICIENCY,
    JOINT_COMPLIANCE,
    LOAD_FRICTION,
    STRIBECK,
    VISCOUS,
)
from residual_mpc.effects.command import COMMAND_DELAY, DEAD_ZONE
from residual_mpc.effects.effect import Effect
from residual_mpc.effects.position_servo import POSITION_GAIN, SERVO_INTEGRAL
from residual_mpc.effects.sensor import SENSOR_BIAS

How = Literal["times", "plus", "is", "at most"]  # what a parameter does to the model's own value


@dataclass(frozen=True)
class Source:
    """A parameter that says the number. power: of the gear, by which it is multiplied to be at the joint."""

    effect: Effect
    parameter: str
    how: How
    power: int = 0


@dataclass(frozen=True)
class ServoNumber:
    """One column of the table.

    Attributes:
        name: key in documents. text: heading.
        unit: on a joint that turns.
        field: of `ActuatorValues` with the model's own value; empty where a model has none.
        absent: the value of a model that has none; None: no limit, rigid.
        sources: the effects that change it; those named act together.
        kinds: of actuators that have it; empty: all.
        constant: of `Motor`, which gives the same quantity; empty where none does.
        same_as: name of another number, beside which it says nothing where both are equal.
    """

    name: str
    text: str
    unit: str
    field: str
    absent: float | None
    sources: tuple[Source, ...]
    kinds: tuple[str, ...] = ()
    constant: str = ""
    same_as: str = ""


NUMBERS: tuple[ServoNumber, ...] = (
    ServoNumber("stiffness", "stiffness", "N m/rad", "stiffness", 0.0,
                (Source(ACTUATOR_GAIN, "gain", "times"), Source(POSITION_GAIN, "gain", "times")), ("position",),
                "stiffness"),
    ServoNumber("damping", "servo damping", "N m s/rad", "damping", 0.0, (Source(ACTUATOR_GAIN, "gain", "times"),),
                ("position", "velocity"), "damping"),
    ServoNumber("gain", "gain", "1", "", 1.0, (Source(ACTUATOR_GAIN, "gain", "times"),), ("torque",)),
    ServoNumber("gain_loss", "loss of gain", "1/s", "", 0.0, (Source(VOLTAGE_SAG, "rate", "is"),)),
    ServoNumber("integral_gain", "integral gain", "1/s", "", 0.0, (Source(SERVO_INTEGRAL, "gain", "is"),),
                ("position",)),
    ServoNumber("dry_friction", "dry friction", "N m", "friction", 0.0,
                (Source(COULOMB, "torque", "plus"), Source(STRIBECK, "kinetic", "plus"))),
    ServoNumber("breakaway_friction", "breakaway friction", "N m", "friction", 0.0,
                (Source(COULOMB, "torque", "plus"), Source(STRIBECK, "static", "plus")), same_as="dry_friction"),
    ServoNumber("viscous_friction", "viscous friction", "N m s/rad", "viscous_friction", 0.0,
                (Source(VISCOUS, "coefficient", "plus"),)),
    ServoNumber("load_friction", "load-dependent friction", "1", "", 0.0,
                (Source(LOAD_FRICTION, "coefficient", "is"),)),
    ServoNumber("load_friction_growth", "growth of load-dependent friction", "1/(N m)", "", 0.0,
                (Source(LOAD_FRICTION, "quadratic", "is"),)),
    ServoNumber("efficiency_forward", "efficiency when driving", "1", "", 1.0,
                (Source(GEAR_EFFICIENCY, "forward", "is"),)),
    ServoNumber("efficiency_backward", "efficiency when driven", "1", "", 1.0,
                (Source(GEAR_EFFICIENCY, "backward", "is"),)),
    ServoNumber("backlash", "backlash", "rad", "", 0.0, (Source(BACKLASH, "gap", "is"),)),
    ServoNumber("gear_stiffness", "gear stiffness", "N m/rad", "", None,
                (Source(JOINT_COMPLIANCE, "stiffness", "is"),)),
    ServoNumber("rotor_inertia", "rotor inertia", "kg m^2", "armature", 0.0, (Source(ARMATURE, "inertia", "plus"),)),
    ServoNumber("torque_limit", "torque limit", "N m", "effort_limit", None,
                (Source(SATURATION, "limit", "is", 1), Source(TORQUE_SPEED_LIMIT, "stall_torque", "at most", 1)),
                (), "stall_torque"),
    ServoNumber("no_load_speed", "no-load speed", "rad/s", "", None,
                (Source(TORQUE_SPEED_LIMIT, "no_load_speed", "is", -1),), (), "no_load_speed"),
    ServoNumber("setpoint_rate", "setpoint rate", "rad/s", "", None, (Source(RATE_LIMIT, "rate", "is", -1),),
                ("position",)),
    ServoNumber("dead_band", "dead band", "rad", "", 0.0, (Source(DEAD_ZONE, "width", "is", -1),), ("position",)),
    ServoNumber("delay", "command delay", "s", "delay", 0.0, (Source(COMMAND_DELAY, "delay", "plus"),)),
    ServoNumber("lag", "lag", "s", "lag", 0.0, (Source(ACTUATOR_LAG, "time_constant", "plus"),)),
    ServoNumber("offset", "encoder offset", "rad", "", 0.0, (Source(SENSOR_BIAS, "bias", "is"),)),
)  # fmt: skip
BY_NAME = {number.name: number for number in NUMBERS}
# an actuator gain scales the first two, which belong to the servo; the third is the joint's own damping
SERVO_STIFFNESS, SERVO_DAMPING, JOINT_DAMPING = "stiffness", "damping", "viscous_friction"
