"""Effects of the sensors: what is reported is not what the model's state is."""

import math

from residual_mpc.effects.effect import Effect, Parameter, Values
from residual_mpc.effects.ops import Array, Ops


def mounted(ops: Ops, p: Values, x: Array, y: Array, theta: Array) -> tuple[Array, Array]:
    """World position (m, m) of a point at (p.x, p.y) in the body frame of a robot at (x, y, theta)."""
    c, s = ops.cos(theta), ops.sin(theta)
    return x + (c * p["x"] - s * p["y"]), y + (s * p["x"] + c * p["y"])


def unmounted(ops: Ops, p: Values, x: Array, y: Array, theta: Array) -> tuple[Array, Array]:
    """The robot's position from that of the tracked point: the inverse of `mounted`."""
    c, s = ops.cos(theta), ops.sin(theta)
    return x - (c * p["x"] - s * p["y"]), y - (s * p["x"] + c * p["y"])


SENSOR_DELAY = Effect(
    name="sensor_delay",
    stage="sensor",
    port="sensor",
    target="channel",
    parameters=(Parameter("delay", "s", 0.0, 0.0, 0.3, (0.01, 0.04, 0.1), tolerance=0.005),),
    summary="measurements arrive late",
)

SENSOR_BIAS = Effect(
    name="sensor_bias",
    stage="sensor",
    port="sensor",
    target="channel",
    parameters=(Parameter("bias", "channel unit", 0.0, -math.inf, math.inf, (0.03, -0.03), tolerance=0.005),),
    summary="a constant offset of one channel",
    null_target=False,
)

SENSOR_MOUNTING = Effect(
    name="sensor_mounting",
    stage="sensor",
    port="sensor",
    target="robot",
    parameters=(
        Parameter("x", "m", 0.0, -2.0, 2.0, (0.03, 0.0), tolerance=0.004),
        Parameter("y", "m", 0.0, -2.0, 2.0, (0.0, 0.03), tolerance=0.004),
    ),
    summary="the tracked point is not the point that the model moves",
)

SENSOR_OUTLIERS = Effect(
    name="sensor_outliers",
    stage="sensor",
    port="sensor",
    target="robot",
    parameters=(Parameter("rate", "1", 0.0, 0.0, 1.0, ()),),
    summary="samples that jump away",
)
