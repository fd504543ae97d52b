"""Effects between the wheels and the ground."""

import math

from residual_mpc.effects.effect import Effect, Parameter, Values
from residual_mpc.effects.ops import Array, Ops
from residual_mpc.effects.phrase import Noun, Phrase

GRAVITY = 9.81  # m/s^2
WHEELS_UNCHANGED = "wheel bodies and shapes are not modified in the MJCF"


def slipping_rim(ops: Ops, p: Values, v: Array, a: Array) -> Array:
    """Ground speed of a rim, m/s: v (1 - coefficient |a| / g).

    v: the rim's own speed, m/s; a: its acceleration, m/s^2. A slipping wheel never drives backwards: the factor stops
    at zero, which the contract's formula leaves open.
    """
    return v * ops.maximum(1.0 - p["coefficient"] * ops.absolute(a) / GRAVITY, 0.0)


def radius_over_turn(ops: Ops, p: Values, angle: Array) -> Array:
    """Radius of a wheel at its angle (rad) over its mean radius: 1 + amplitude cos(angle + phase)."""
    return 1.0 + p["amplitude"] * ops.cos(angle + p["phase"])


def sideslip(ops: Ops, p: Values, forward: Array, yaw: Array) -> Array:
    """Sideways speed to the left, m/s, of a base that is carried outwards in a turn, away from its centre."""
    return -p["coefficient"] * forward * yaw


def slope_drift(ops: Ops, p: Values) -> tuple[Array, Array]:
    """World-frame drift (m/s, m/s) of a robot on a slope."""
    return p["rate"] * ops.cos(p["heading"]), p["rate"] * ops.sin(p["heading"])


WHEEL_RADIUS = Effect(
    name="wheel_radius",
    stage="contact",
    port="model",
    target="robot",
    parameters=(Parameter("scale", "1", 1.0, 0.05, 3.0, (0.85, 1.15), tolerance=0.01, quantity="wheel radius"),),
    summary="both wheels larger or smaller",
    site="rolling",
    imitates=frozenset({"time", "speed"}),
    interchangeable="rim speed",
    phrase=Phrase("the effective wheel radius is {scale} of the modelled one", shares=("scale",)),
    nouns={"scale": Noun("effective wheel radius", "factor")},
    not_in_mjcf=WHEELS_UNCHANGED,
)

WHEEL_RADIUS_MISMATCH = Effect(
    name="wheel_radius_mismatch",
    stage="contact",
    port="model",
    target="robot",
    parameters=(Parameter("ratio", "1", 1.0, 0.3, 3.0, (0.95, 1.05), tolerance=0.005, quantity="right wheel radius"),),
    summary="one wheel larger than the other",
    site="rolling",
    interchangeable="rim speed",
    phrase=Phrase("the radius of the right wheel is {ratio} of that of the left wheel", shares=("ratio",)),
    nouns={"ratio": Noun("ratio of right to left wheel radius", "ratio")},
    not_in_mjcf=WHEELS_UNCHANGED,
)

TRACK_WIDTH = Effect(
    name="track_width",
    stage="contact",
    port="model",
    target="robot",
    parameters=(Parameter("scale", "1", 1.0, 0.1, 20.0, (0.8, 1.25, 2.0), tolerance=0.015, quantity="track width"),),
    summary="another effective track width",
    site="rolling",
    unseen="the robot hardly turns",
    imitates=frozenset({"turning"}),
    phrase=Phrase("the robot turns as if its track were {scale} times as wide"),
    nouns={"scale": Noun("effective track width", "factor")},
    not_in_mjcf=WHEELS_UNCHANGED,
)

LATERAL_SLIP = Effect(
    name="lateral_slip",
    stage="contact",
    port="ground",
    target="robot",
    parameters=(Parameter("coefficient", "s", 0.0, -2.0, 2.0, (0.05, 0.3), tolerance=0.015),),
    summary="sideways drift in turns",
    step=sideslip,
    site="side",
    unseen="the robot hardly turns while it drives",
    phrase=Phrase("the robot slips outwards in turns (coefficient {coefficient})"),
    nouns={"coefficient": Noun("coefficient of lateral slip", appears="lateral slip", article="", size="coefficient")},
)

LONGITUDINAL_SLIP = Effect(
    name="longitudinal_slip",
    stage="contact",
    port="ground",
    target="robot",
    parameters=(Parameter("coefficient", "1", 0.0, 0.0, 20.0, (0.3, 2.0), tolerance=0.05),),
    summary="wheels that slip when they accelerate",
    step=slipping_rim,
    site="rim",
    unseen="the robot hardly accelerates",
    phrase=Phrase("the wheels slip when they accelerate (coefficient {coefficient})"),
    nouns={"coefficient": Noun("coefficient of wheel slip", appears="wheel slip", article="", size="coefficient")},
)

WHEEL_ECCENTRICITY = Effect(
    name="wheel_eccentricity",
    stage="contact",
    port="ground",
    target="actuator",
    parameters=(
        Parameter("amplitude", "1", 0.0, 0.0, 0.6, (0.03,)),
        Parameter("phase", "rad", 0.0, -math.inf, math.inf, (0.0,), shape=True),
    ),
    summary="a wheel's radius varies once a turn",
    step=radius_over_turn,
    null_target=False,
    site="roundness",
    unseen="the wheel hardly turns, or a plausible eccentricity moves the robot by less than the noise",
    phrase=Phrase("the radius of {who} varies by {amplitude} either way over a turn", shares=("amplitude",)),
    nouns={
        "amplitude": Noun("variation of the radius over a turn", "own", "eccentricity", "an", "amplitude"),
    },
    not_in_mjcf=WHEELS_UNCHANGED,
)

SLOPE = Effect(
    name="slope",
    stage="contact",
    port="ground",
    target="robot",
    parameters=(
        Parameter("rate", "m/s", 0.0, 0.0, 1.0, (0.02, 0.02, 0.02, 0.02), tolerance=0.002),
        Parameter("heading", "rad", 0.0, -math.inf, math.inf, (0.0, 1.5708, 3.1416, -1.5708), shape=True),
    ),
    summary="steady drift in one world direction",
    step=slope_drift,
    site="drift",
    phrase=Phrase("the robot drifts at {rate} in a fixed direction"),
    nouns={"rate": Noun("drift in a fixed direction")},
)

EFFECTS = (WHEEL_RADIUS, WHEEL_RADIUS_MISMATCH, TRACK_WIDTH, LATERAL_SLIP, LONGITUDINAL_SLIP, WHEEL_ECCENTRICITY, SLOPE)
