"""Effects of a base controller, which decides on the speeds of two wheels together: the mean of the two speeds moves
the base forward, half of their difference turns it."""

import math

from residual_mpc.effects.effect import Effect, Parameter, Values
from residual_mpc.effects.ops import Array, Ops, clip
from residual_mpc.effects.phrase import Noun, Phrase

LEAST = 1e-3  # rad/s, of a limit in whose proportion wheels slow down
NOT_IN_MJCF = "MuJoCo has no actuator that depends on the command of another"


def turn_gain_step(ops: Ops, p: Values, left: Array, right: Array) -> tuple[Array, Array]:
    """Both speeds with half of their difference times the gain, written as what is missing, so that a gain of one
    changes no bit."""
    missing = 0.5 * (1.0 - p["gain"]) * (right - left)
    return left + missing, right - missing


def turn_limit_step(ops: Ops, p: Values, left: Array, right: Array) -> tuple[Array, Array]:
    """Both speeds with half of their difference held within +-limit, their mean unchanged (the limit of the angular
    velocity in a base controller, such as `angular.z.max_velocity` of ROS 2's diff_drive_controller)."""
    half = 0.5 * (right - left)
    excess = half - clip(ops, half, -p["limit"], p["limit"])
    return left + excess, right - excess


def shared_limit_step(ops: Ops, p: Values, left: Array, right: Array) -> tuple[Array, Array]:
    """Both speeds times limit / max(limit, |left|, |right|): the path keeps its curvature."""
    fastest = ops.maximum(ops.absolute(left), ops.absolute(right))
    share = 1.0 / (1.0 + (fastest - ops.minimum(fastest, p["limit"])) / p["limit"])
    return left * share, right * share


TURN_GAIN = Effect(
    name="turn_gain",
    stage="actuator",
    port="pair",
    target="robot",
    parameters=(Parameter("gain", "1", 1.0, 0.02, 5.0, (0.4, 0.85, 1.2), tolerance=0.01),),
    summary="the difference between the wheels' speeds is scaled",
    step=turn_gain_step,
    site="pair",
    rank=22,
    steady=True,
    unseen="the robot hardly turns",
    imitates=frozenset({"turning"}),
    phrase=Phrase("the wheels' speeds differ by {gain} of the commanded difference", shares=("gain",)),
    nouns={"gain": Noun("gain of the wheels' difference", "factor")},
    not_in_mjcf=NOT_IN_MJCF,
)

TURN_LIMIT = Effect(
    name="turn_limit",
    stage="actuator",
    port="pair",
    target="robot",
    parameters=(Parameter("limit", "rad/s", math.inf, 0.0, math.inf, (0.8, 0.5, 0.25), "turn", True, most=1.2),),
    summary="half of the difference between the wheels' speeds stops at a limit",
    step=turn_limit_step,
    site="pair",
    rank=24,
    steady=True,
    kink="signal",
    unseen="no command near such a limit",
    phrase=Phrase("half of the difference between the wheels' speeds stops at {limit}"),
    nouns={"limit": Noun("turn limit")},
    not_in_mjcf=NOT_IN_MJCF,
)

SHARED_LIMIT = Effect(
    name="shared_limit",
    stage="actuator",
    port="pair",
    target="robot",
    parameters=(
        Parameter("limit", "rad/s", math.inf, LEAST, math.inf, (0.9, 0.75, 0.5, 0.3), "output", True, most=1.2),
    ),
    summary="both wheels slow down in proportion where one of them would exceed a limit",
    step=shared_limit_step,
    site="pair",
    rank=26,
    steady=True,
    kink="signal",
    unseen="no command near the wheels' limit",
    phrase=Phrase("both wheels slow down in proportion where one of them would exceed {limit}"),
    nouns={"limit": Noun("shared limit of the wheels' speeds")},
    not_in_mjcf=NOT_IN_MJCF,
)

EFFECTS = (TURN_GAIN, TURN_LIMIT, SHARED_LIMIT)
