"""Effects of the moving bodies: frictions (a torque against the motion) and what changes the masses."""

import math

from residual_mpc.effects.effect import Effect, Parameter, Values
from residual_mpc.effects.ops import Array, Ops


def coulomb_level(ops: Ops, p: Values, w: Array, tau: Array) -> Array:
    """Dry friction, N m, times sgn(w)."""
    return p["torque"]


def stribeck_level(ops: Ops, p: Values, w: Array, tau: Array) -> Array:
    """kinetic + (static - kinetic) exp(-(w / velocity)^2), N m, times sgn(w) (Armstrong-Helouvry et al. 1994, eq.
    4).
    """
    return p["kinetic"] + (p["static"] - p["kinetic"]) * ops.exp(-((w / p["velocity"]) ** 2))


def load_level(ops: Ops, p: Values, w: Array, tau: Array) -> Array:
    """coefficient * |actuator torque|, N m, times sgn(w)."""
    return p["coefficient"] * ops.absolute(tau)


def viscous_torque(ops: Ops, p: Values, w: Array, tau: Array) -> Array:
    """coefficient * w, N m, against the motion."""
    return p["coefficient"] * w


COULOMB = Effect(
    name="coulomb_friction",
    stage="body",
    port="friction",
    target="joint",
    parameters=(Parameter("torque", "N m", 0.0, -math.inf, math.inf, (0.05, 0.2, 0.5), "torque", tolerance=0.05),),
    summary="dry friction in a joint",
    step=coulomb_level,
)

VISCOUS = Effect(
    name="viscous_friction",
    stage="body",
    port="friction",
    target="joint",
    parameters=(
        Parameter("coefficient", "N m s/rad", 0.0, -math.inf, math.inf, (0.1, 0.4), "torque/speed", tolerance=0.05),
    ),
    summary="friction that grows with speed",
    step=viscous_torque,
)

STRIBECK = Effect(
    name="stribeck_friction",
    stage="body",
    port="friction",
    target="joint",
    parameters=(
        Parameter("static", "N m", 0.0, 0.0, math.inf, (0.2, 0.5), "torque"),
        Parameter("kinetic", "N m", 0.0, 0.0, math.inf, (0.1, 0.2), "torque"),
        Parameter("velocity", "rad/s", 0.1, 0.005, 2.0, (0.05, 0.15), shape=True),
    ),
    summary="dry friction that is larger at rest than in motion",
    step=stribeck_level,
    sensible=lambda p: p["static"] >= p["kinetic"],
)

LOAD_FRICTION = Effect(
    name="load_dependent_friction",
    stage="body",
    port="friction",
    target="joint",
    parameters=(Parameter("coefficient", "1", 0.0, 0.0, 0.9, (0.1, 0.3), tolerance=0.03),),
    summary="dry friction that grows with the torque that the gear carries",
    step=load_level,
)

PAYLOAD = Effect(
    name="payload",
    stage="body",
    port="model",
    target="robot",
    parameters=(Parameter("mass", "kg", 0.0, -math.inf, math.inf, (0.1, 0.4), "mass", tolerance=0.05),),
    summary="a mass at the payload site",
)

LINK_MASS = Effect(
    name="link_mass",
    stage="body",
    port="model",
    target="body",
    parameters=(
        Parameter("mass", "kg", 0.0, -math.inf, math.inf, (0.3, -0.3), "mass", tolerance=0.05),
        Parameter("com", "m", 0.0, -0.5, 0.5, (0.0, 0.0)),
    ),
    summary="a link heavier or lighter than modelled",
    null_target=False,
)

ARMATURE = Effect(
    name="armature",
    stage="body",
    port="model",
    target="joint",
    parameters=(Parameter("inertia", "kg m^2", 0.0, -math.inf, math.inf, (0.3, 1.5, 8.0), "inertia", tolerance=0.1),),
    summary="rotor inertia seen through the gear",
)

JOINT_COMPLIANCE = Effect(
    name="joint_compliance",
    stage="body",
    port="model",
    target="joint",
    # in units of the inertia: springs on which the link swings at 25 and 80 rad/s
    parameters=(Parameter("stiffness", "N m/rad", math.inf, 0.0, math.inf, (600.0, 6000.0), "inertia"),),
    summary="a spring between motor and link",
)

LINK_LENGTH = Effect(
    name="link_length",
    stage="body",
    port="model",
    target="body",
    parameters=(Parameter("offset", "m", 0.0, -math.inf, math.inf, (0.1, -0.1), "length", tolerance=0.01),),
    summary="a link longer or shorter than modelled",
    null_target=False,
)
