"""What each parameter of an effect is called where its value before and after are compared."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

Kind = Literal["own", "excess", "factor", "ratio"]


@dataclass(frozen=True)
class Quantity:
    """noun: as it follows "the"; targeted: the shorter one before "of" and a target.

    kind: `own`, of something that the model lacks and that may appear or disappear; `excess`, what a quantity has more
    than the model says; `factor`, of what the model says; `ratio`, of two quantities of the robot. Where it appears or
    disappears: appears: what, if not the noun; article: the one that it takes; size: what its number is called, if that
    needs saying; inside: the preposition before the target."""

    noun: str
    kind: Kind = "own"
    appears: str = ""
    article: str = "a"
    size: str = ""
    inside: str = "of"
    targeted: str = ""


QUANTITIES: Mapping[str, Mapping[str, Quantity]] = {
    "command_delay": {"delay": Quantity("command delay", targeted="delay")},
    "dead_zone": {"width": Quantity("dead zone", inside="in")},
    "actuator_lag": {"time_constant": Quantity("actuator lag", article="an", targeted="lag")},
    "actuator_gain": {"gain": Quantity("actuator gain", "factor", targeted="gain")},
    "saturation": {"limit": Quantity("output limit", article="an")},
    "voltage_sag": {"rate": Quantity("loss of gain")},
    "backlash": {"gap": Quantity("backlash", article="", inside="in")},
    "coulomb_friction": {"torque": Quantity("dry friction", "excess")},
    "viscous_friction": {"coefficient": Quantity("viscous friction", "excess")},
    "stribeck_friction": {
        "static": Quantity("friction near standstill", "excess"),
        "kinetic": Quantity("friction at speed", "excess"),
    },
    "load_dependent_friction": {"coefficient": Quantity("load-dependent friction", article="", inside="in")},
    "payload": {"mass": Quantity("payload", "excess")},
    "link_mass": {"mass": Quantity("mass", "excess"), "com": Quantity("distance of the centre of mass", "excess")},
    "armature": {"inertia": Quantity("rotor inertia", "excess")},
    "joint_compliance": {
        "stiffness": Quantity("stiffness", appears="elasticity", article="", size="stiffness", inside="in")
    },
    "link_length": {"offset": Quantity("length", "excess")},
    "wheel_radius": {"scale": Quantity("effective wheel radius", "factor")},
    "wheel_radius_mismatch": {"ratio": Quantity("ratio of right to left wheel radius", "ratio")},
    "track_width": {"scale": Quantity("effective track width", "factor")},
    "lateral_slip": {
        "coefficient": Quantity("coefficient of lateral slip", appears="lateral slip", article="", size="coefficient")
    },
    "longitudinal_slip": {
        "coefficient": Quantity("coefficient of wheel slip", appears="wheel slip", article="", size="coefficient")
    },
    "slope": {"rate": Quantity("drift in a fixed direction")},
    "sensor_delay": {"delay": Quantity("sensor delay", targeted="delay")},
    "sensor_bias": {"bias": Quantity("bias", "excess")},
    "sensor_mounting": {
        "x": Quantity("x coordinate of the tracked point in the body frame", "excess"),
        "y": Quantity("y coordinate of the tracked point in the body frame", "excess"),
    },
    "sensor_outliers": {"rate": Quantity("share of outliers", appears="outliers", article="")},
}
