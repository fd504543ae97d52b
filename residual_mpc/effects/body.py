"""Effects of the moving bodies: frictions (a torque against the motion) and what changes the masses."""

import math
from collections.abc import Mapping

from residual_mpc.effects.effect import Effect, Parameter, Quantity, Values
from residual_mpc.effects.gear import DAMPING_BEHIND
from residual_mpc.effects.ops import Array, Ops
from residual_mpc.effects.phrase import Noun, Phrase

# what a joint's own number is compared with, by the last word of its name in a model: see `Parameter.reference`
USUAL_SIZES = {"damping": "torque/speed", "armature": "inertia", "frictionloss": "torque"}


def coulomb_level(ops: Ops, p: Values, w: Array, tau: Array) -> Array:
    """Dry friction, N m, times sgn(w)."""
    return p["torque"]


def stribeck_level(ops: Ops, p: Values, w: Array, tau: Array) -> Array:
    """kinetic + (static - kinetic) exp(-(w / velocity)^2), N m, times sgn(w) (Armstrong-Helouvry et al. 1994, eq.
    4).
    """
    return p["kinetic"] + (p["static"] - p["kinetic"]) * ops.exp(-((w / p["velocity"]) ** 2))


def load_level(ops: Ops, p: Values, w: Array, tau: Array) -> Array:
    """(coefficient + quadratic |actuator torque|) |actuator torque|, N m, times sgn(w) (Duclusaud et al., Extended
    friction models for the physics simulation of servo actuators, ICRA 2025, model M6, without its load's torque)."""
    load = ops.absolute(tau)
    return (p["coefficient"] + p["quadratic"] * load) * load


def gear_level(ops: Ops, p: Values, w: Array, tau: Array) -> Array:
    """What a gear loses, N m, times sgn(w): (1 - forward) |tau| while the motor drives, (1 / backward - 1) |tau| while
    the load drives it (Siciliano et al., Robotics, 2009, section 5.2, with an efficiency for each direction)."""
    driving = tau * w > 0
    return ops.where(driving, 1.0 - p["forward"], 1.0 / p["backward"] - 1.0) * ops.absolute(tau)


def viscous_torque(ops: Ops, p: Values, w: Array, tau: Array) -> Array:
    """coefficient * w, N m, against the motion."""
    return p["coefficient"] * w


COULOMB = Effect(
    name="coulomb_friction",
    stage="body",
    port="friction",
    target="joint",
    parameters=(
        Parameter(
            "torque",
            "N m",
            0.0,
            -math.inf,
            math.inf,
            (0.05, 0.2, 0.5),
            "torque",
            tolerance=0.05,
            quantity="dry friction",
        ),
    ),
    summary="dry friction in a joint",
    step=coulomb_level,
    site="dry friction",
    rank=10,
    steady=True,
    stalls=("torque",),
    imitates=frozenset({"time", "position"}),
    laws=(("friction", None, "constant"),),
    phrase=Phrase("{who} has {torque} more dry friction than modelled"),
    nouns={"torque": Noun("dry friction", "excess")},
)

VISCOUS = Effect(
    name="viscous_friction",
    stage="body",
    port="friction",
    target="joint",
    parameters=(
        Parameter(
            "coefficient",
            "N m s/rad",
            0.0,
            -math.inf,
            math.inf,
            (0.1, 0.4),
            "torque/speed",
            tolerance=0.05,
            quantity="viscous damping",
        ),
    ),
    summary="friction that grows with speed",
    step=viscous_torque,
    site="damping",
    imitates=frozenset({"time", "speed"}),
    laws=(("torque", "speed", "line"),),
    phrase=Phrase("{who} has {coefficient} more viscous friction than modelled"),
    nouns={"coefficient": Noun("viscous friction", "excess")},
)

STRIBECK = Effect(
    name="stribeck_friction",
    stage="body",
    port="friction",
    target="joint",
    parameters=(
        Parameter("static", "N m", 0.0, 0.0, math.inf, (0.2, 0.5), "torque", quantity="dry friction"),
        Parameter("kinetic", "N m", 0.0, 0.0, math.inf, (0.1, 0.2), "torque", quantity="dry friction"),
        Parameter("velocity", "rad/s", 0.1, 0.005, 2.0, (0.05, 0.15), shape=True),
    ),
    summary="dry friction that is larger at rest than in motion",
    step=stribeck_level,
    sensible=lambda p: p["static"] >= p["kinetic"],
    equal=("coulomb_friction", ("static", "kinetic")),
    rank=20,
    stalls=("static", "kinetic"),
    unseen="no slow motion in which the friction would rise",
    phrase=Phrase("the friction of {who} differs from the model by {static} near standstill and {kinetic} at speed"),
    nouns={"static": Noun("friction near standstill", "excess"), "kinetic": Noun("friction at speed", "excess")},
    in_mjcf="constant dry friction midway between static and kinetic, since MuJoCo's has no speed dependence",
    settled=lambda p: 0.5 * (p["static"] + p["kinetic"]),
)

LOAD_FRICTION = Effect(
    name="load_dependent_friction",
    stage="body",
    port="friction",
    target="joint",
    parameters=(
        Parameter("coefficient", "1", 0.0, 0.0, 0.9, (0.1, 0.3), tolerance=0.03),
        Parameter("quadratic", "1/(N m)", 0.0, 0.0, math.inf, (0.1,), "1/torque", shape=True, most=1.0, optional=True),
    ),
    summary="dry friction that grows with the torque that the gear carries",
    step=load_level,
    rank=30,
    stalls=("coefficient",),
    unseen="the torque hardly varies",
    imitates=frozenset({"position", "load"}),
    phrase=Phrase(
        "friction in {who} takes {coefficient} of the transmitted torque",
        located=", and {where} of it",
        optional={"quadratic": "{value} more for each {per}"},
        shares=("coefficient", "quadratic"),
    ),
    nouns={"coefficient": Noun("load-dependent friction", article="", inside="in")},
    not_in_mjcf="MuJoCo's dry friction does not depend on the load",
)

TOOL_AXES: Mapping[str, Quantity] = {"x": "tool x", "y": "tool y", "z": "tool z"}  # parameter -> what it changes


def _offset(name: str, quantity: Quantity) -> Parameter:
    """One coordinate of the payload, from its site along the site's axes."""
    return Parameter(name, "m", 0.0, -math.inf, math.inf, (0.0,), shape=True, quantity=quantity, optional=True)


PAYLOAD = Effect(
    name="payload",
    stage="body",
    port="model",
    target="robot",
    parameters=(
        Parameter("mass", "kg", 0.0, -math.inf, math.inf, (0.1, 0.4), "mass", tolerance=0.05, quantity="tool mass"),
        *(_offset(name, quantity) for name, quantity in TOOL_AXES.items()),
    ),
    summary="a mass at or near the payload site",
    site="tool",
    imitates=frozenset({"position"}),
    phrase=Phrase(
        "the robot carries {mass} more than modelled",
        located=", {where} from the payload site",
        optional={axis: f"{{value}} along {axis}" for axis in TOOL_AXES},
    ),
    nouns={"mass": Noun("payload", "excess")},
)

LINK_MASS = Effect(
    name="link_mass",
    stage="body",
    port="model",
    target="body",
    parameters=(
        Parameter("mass", "kg", 0.0, -math.inf, math.inf, (0.3, -0.3), "mass", tolerance=0.05, quantity="link mass"),
        Parameter("com", "m", 0.0, -0.5, 0.5, (0.0, 0.0), quantity="link centre", within="length"),
    ),
    summary="a link heavier or lighter than modelled",
    null_target=False,
    site="link",
    imitates=frozenset({"position"}),
    phrase=Phrase(
        "{who} is {mass} heavier than modelled",
        instead={"com": "the centre of mass of {who} is {com} farther from its joint than modelled"},
    ),
    nouns={"mass": Noun("mass", "excess"), "com": Noun("distance of the centre of mass", "excess")},
)

ARMATURE = Effect(
    name="armature",
    stage="body",
    port="model",
    target="joint",
    parameters=(
        Parameter(
            "inertia",
            "kg m^2",
            0.0,
            -math.inf,
            math.inf,
            (0.3, 1.5, 8.0),
            "inertia",
            tolerance=0.1,
            quantity="rotor inertia",
        ),
    ),
    summary="rotor inertia seen through the gear",
    site="rotor",
    phrase=Phrase("{who} has {inertia} more rotor inertia than modelled"),
    nouns={"inertia": Noun("rotor inertia", "excess")},
)

JOINT_COMPLIANCE = Effect(
    name="joint_compliance",
    stage="body",
    port="model",
    target="joint",
    # in units of the inertia: springs on which the link swings at 25 and 80 rad/s
    parameters=(
        Parameter(
            "stiffness", "N m/rad", math.inf, 0.0, math.inf, (600.0, 6000.0), "inertia", quantity="gear stiffness"
        ),
        # of the swing of motor and link against each other; steel and grease have 0.02 to 0.1, rubber 0.3
        Parameter("damping_ratio", "1", 0.05, 0.0, 1.0, (0.05, 0.05), shape=True, quantity="gear damping"),
        DAMPING_BEHIND,
    ),
    summary="a spring between motor and link",
    site="spring",
    unseen="the torque that the gear carries hardly varies",
    phrase=Phrase(
        "{who} is elastic, with a stiffness of {stiffness}",
        "every gear",
        "the gear of {}",
        located=", and {where}",
        optional={"damping_behind": "{value} of the joint's friction sits on the link"},
        shares=("damping_behind",),
    ),
    nouns={"stiffness": Noun("stiffness", appears="elasticity", article="", size="stiffness", inside="in")},
    not_in_mjcf="it needs an additional joint behind the motor, which only the built-in simulator has",
)

LINK_LENGTH = Effect(
    name="link_length",
    stage="body",
    port="model",
    target="body",
    parameters=(
        Parameter(
            "offset", "m", 0.0, -math.inf, math.inf, (0.1, -0.1), "length", tolerance=0.01, quantity="link length"
        ),
    ),
    summary="a link longer or shorter than modelled",
    null_target=False,
    site="length",
    unseen="the joints before it hardly move, or they carry little",
    phrase=Phrase("{who} is {offset} longer than modelled"),
    nouns={"offset": Noun("length", "excess")},
)

GEAR_EFFICIENCY = Effect(
    name="gear_efficiency",
    stage="body",
    port="friction",
    target="joint",
    parameters=(
        Parameter("forward", "1", 1.0, 0.1, 1.0, (0.8, 1.0)),
        Parameter("backward", "1", 1.0, 0.1, 1.0, (1.0, 0.8)),
    ),
    summary="a gear that loses more while driving than while being driven, or less",
    step=gear_level,
    null_target=False,
    rank=35,
    stalls=("forward", "backward"),
    unseen="the torque hardly varies, or the load never drives the motor",
    imitates=frozenset({"position", "load"}),
    phrase=Phrase(
        "the gear of {who} passes on {forward} of the torque while driving and {backward} while being driven",
        shares=("forward", "backward"),
    ),
    nouns={
        "forward": Noun("efficiency while driving", "factor"),
        "backward": Noun("efficiency while being driven", "factor"),
    },
    not_in_mjcf="MuJoCo's dry friction does not depend on the load",
)

EFFECTS = (
    COULOMB,
    VISCOUS,
    STRIBECK,
    LOAD_FRICTION,
    PAYLOAD,
    LINK_MASS,
    ARMATURE,
    JOINT_COMPLIANCE,
    LINK_LENGTH,
)
