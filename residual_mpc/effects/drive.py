"""Effects of a base controller, which decides on the speeds of two wheels together: the mean of the two speeds moves
the base forward, half of their difference turns it."""

import math
from typing import Any

import numpy as np

from residual_mpc.effects.effect import Effect, Parameter, Values, no_memory
from residual_mpc.effects.ops import Array, Ops, clip
from residual_mpc.effects.phrase import Noun, Phrase
from residual_mpc.effects.ramp import missing, missing_at_end

Pair = tuple[Array, Array]  # of the left and of the right wheel, rad/s
LEAST = 1e-3  # rad/s, of a limit in whose proportion wheels slow down
NOT_IN_MJCF = "MuJoCo has no actuator that depends on the command of another"


def turn_gain_step(ops: Ops, p: Values, memory: Any, left: Array, right: Array, dt: float) -> tuple[Pair, Any]:
    """Both speeds with half of their difference times the gain, written as what is missing, so that a gain of one
    changes no bit."""
    missing = 0.5 * (1.0 - p["gain"]) * (right - left)
    return (left + missing, right - missing), memory


def turn_limit_step(ops: Ops, p: Values, memory: Any, left: Array, right: Array, dt: float) -> tuple[Pair, Any]:
    """Both speeds with half of their difference held within +-limit, their mean unchanged (the limit of the angular
    velocity in a base controller, such as `angular.z.max_velocity` of ROS 2's diff_drive_controller)."""
    half = 0.5 * (right - left)
    excess = half - clip(ops, half, -p["limit"], p["limit"])
    return (left + excess, right - excess), memory


def shared_limit_step(ops: Ops, p: Values, memory: Any, left: Array, right: Array, dt: float) -> tuple[Pair, Any]:
    """Both speeds times limit / max(limit, |left|, |right|): the path keeps its curvature."""
    fastest = ops.maximum(ops.absolute(left), ops.absolute(right))
    share = 1.0 / (1.0 + (fastest - ops.minimum(fastest, p["limit"])) / p["limit"])
    return (left * share, right * share), memory


def forward_rate_start(ops: Ops, p: Values, left: Array, right: Array, dt: float) -> Array:
    """The mean of both speeds has arrived at that of the first commands."""
    return 0.5 * (left + right)


def forward_rate_step(ops: Ops, p: Values, y: Array, left: Array, right: Array, dt: float) -> tuple[Pair, Array]:
    """Both speeds with a mean that moves from y at no more than the rate, half of their difference unchanged (the limit
    of the linear acceleration in ROS 2's diff_drive_controller, `SpeedLimiter::limit_acceleration`, alike for speeding
    up and slowing down): their means over the step, and what y has come to. Written as what is missing, so that an
    infinite rate changes no bit."""
    mean = 0.5 * (left + right)
    less, end = missing(ops, mean - y, p["rate"], dt)
    return (left - less, right - less), mean - end


def turn_rate_start(ops: Ops, p: Values, left: Array, right: Array, dt: float) -> Array:
    """Half of the difference has arrived at that of the first commands."""
    return 0.5 * (right - left)


def turn_rate_step(ops: Ops, p: Values, y: Array, left: Array, right: Array, dt: float) -> tuple[Pair, Array]:
    """Both speeds with half of their difference moving from y at no more than the rate, their mean unchanged (the same
    of the angular acceleration)."""
    half = 0.5 * (right - left)
    less, end = missing(ops, half - y, p["rate"], dt)
    return (left + less, right - less), half - end


def ramp_end(p: Values, u: np.ndarray, end: np.ndarray, y: np.ndarray, dt: float) -> np.ndarray:
    """What the speeds of two wheels (..., 2) have come to at the end of each step behind one of these limits, from
    their means y: the limit takes as much from one wheel as from the other, or gives it, and nothing from the rest."""
    return np.asarray(end - missing_at_end(u - y, p["rate"], dt))


TURN_GAIN = Effect(
    name="turn_gain",
    listed=False,
    stage="actuator",
    port="pair",
    target="robot",
    parameters=(Parameter("gain", "1", 1.0, 0.02, 5.0, (0.4, 0.85, 1.2), tolerance=0.01),),
    summary="the difference between the wheels' speeds is scaled",
    start=no_memory,
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
    listed=False,
    stage="actuator",
    port="pair",
    target="robot",
    parameters=(Parameter("limit", "rad/s", math.inf, 0.0, math.inf, (0.8, 0.5, 0.25), "turn", True, most=1.2),),
    summary="half of the difference between the wheels' speeds stops at a limit",
    start=no_memory,
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
    listed=False,
    stage="actuator",
    port="pair",
    target="robot",
    parameters=(
        Parameter("limit", "rad/s", math.inf, LEAST, math.inf, (0.9, 0.75, 0.5, 0.3), "output", True, most=1.2),
    ),
    summary="both wheels slow down in proportion where one of them would exceed a limit",
    start=no_memory,
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

FORWARD_RATE_LIMIT = Effect(
    name="forward_rate_limit",
    listed=False,
    stage="actuator",
    port="pair",
    target="robot",
    parameters=(Parameter("rate", "rad/s^2", math.inf, 0.0, math.inf, (4.0, 1.0, 0.3, 0.1), "forward/time", True),),
    summary="the mean of the wheels' commands is let through no faster than this",
    start=forward_rate_start,
    step=forward_rate_step,
    at_end=ramp_end,
    site="pair command",
    rank=12,
    label="ramp.forward",
    kink="signal",
    unseen="no forward command changes so fast that a limit would act",
    phrase=Phrase("the mean of the wheels' speeds follows its command no faster than {rate}"),
    nouns={"rate": Noun("forward rate limit", appears="limit of the forward command's rate", size="forward rate")},
    not_in_mjcf=NOT_IN_MJCF,
)

TURN_RATE_LIMIT = Effect(
    name="turn_rate_limit",
    listed=False,
    stage="actuator",
    port="pair",
    target="robot",
    parameters=(Parameter("rate", "rad/s^2", math.inf, 0.0, math.inf, (4.0, 1.0, 0.3, 0.1), "turn/time", True),),
    summary="half of the difference between the wheels' commands is let through no faster than this",
    start=turn_rate_start,
    step=turn_rate_step,
    at_end=ramp_end,
    site="pair command",
    rank=14,
    label="ramp.turn",
    kink="signal",
    unseen="no commanded turn changes so fast that a limit would act",
    phrase=Phrase("half of the difference between the wheels' speeds follows its command no faster than {rate}"),
    nouns={"rate": Noun("turn rate limit", appears="limit of the commanded turn's rate", size="turn rate")},
    not_in_mjcf=NOT_IN_MJCF,
)

EFFECTS = (TURN_GAIN, TURN_LIMIT, SHARED_LIMIT, FORWARD_RATE_LIMIT, TURN_RATE_LIMIT)
