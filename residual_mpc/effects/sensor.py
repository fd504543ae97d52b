"""Effects of the sensors: what is reported is not what the model's state is."""

import math

import numpy as np

from residual_mpc.effects.effect import Effect, Parameter, Values
from residual_mpc.effects.ops import Array, Ops
from residual_mpc.effects.phrase import Noun, Phrase
from residual_mpc.effects.recursion import first_order

EVERY_SENSOR = "sensors"  # the target that is all sensors of a robot together
READ_ELSEWHERE = "sensor effects are not part of the model"


def mounted(ops: Ops, p: Values, x: Array, y: Array, theta: Array) -> tuple[Array, Array]:
    """World position (m, m) of a point at (p.x, p.y) in the body frame of a robot at (x, y, theta)."""
    c, s = ops.cos(theta), ops.sin(theta)
    return x + (c * p["x"] - s * p["y"]), y + (s * p["x"] + c * p["y"])


def unmounted(ops: Ops, p: Values, x: Array, y: Array, theta: Array) -> tuple[Array, Array]:
    """The robot's position from that of the tracked point: the inverse of `mounted`."""
    c, s = ops.cos(theta), ops.sin(theta)
    return x - (c * p["x"] - s * p["y"]), y - (s * p["x"] + c * p["y"])


def off_axis(ops: Ops, p: Values, q: Array) -> Array:
    """rad by which an encoder reads too much whose disc sits off its shaft's axis: a sine of the angle, once a turn, to
    first order in the offset over the disc's radius."""
    return p["amplitude"] * ops.sin(q + p["phase"])


def low_pass(x: np.ndarray, y0: np.ndarray, tau: float, h: float) -> np.ndarray:
    """(..., K + 1) the solution of tau dy/dt = x - y on nodes h s apart, for an input x (..., K + 1) that is straight
    between them, exactly; from the memory y0 (...). The input itself where tau is 0."""
    if tau <= 0.0:
        return x
    a, reach = math.exp(-h / tau), -math.expm1(-h / tau) * tau / h
    old, new = reach - a, 1.0 - reach  # weights of the input at the ends of a step
    y = first_order(a, new * x[..., 1:] + old * x[..., :-1], y0)
    return np.concatenate([y0[..., None], y], axis=-1)


def lateness(skew: np.ndarray, since: np.ndarray) -> np.ndarray:
    """s by which a stamp runs ahead of the command's clock, `since` s (by itself) after both began, where its clock
    gains `skew` s in a second."""
    return np.asarray(skew / (1.0 + skew) * since)


SENSOR_DELAY = Effect(
    name="sensor_delay",
    stage="sensor",
    port="sensor",
    target="channel",
    parameters=(Parameter("delay", "s", 0.0, 0.0, 0.3, (0.01, 0.04, 0.1), tolerance=0.005, quantity="reading delay"),),
    summary="measurements arrive late",
    site="delay",
    phrase=Phrase("{who} arrive {delay} late", "the measurements", "the measurements of {}"),
    nouns={"delay": Noun("sensor delay", targeted="delay")},
    not_in_mjcf=READ_ELSEWHERE,
)

CLOCK_SKEW = Effect(
    name="clock_skew",
    stage="sensor",
    port="sensor",
    target="channel",
    # probed, and bounded, by how far the stamps are off at the end of the longest run, s
    parameters=(Parameter("rate", "1", 0.0, -0.02, 0.02, (0.05,), "1/run", quantity="reading skew", most=0.5),),
    summary="the sensor's clock gains on the command's",
    site="clock",
    seconds=10.0,  # a rate of 0.1 %, far beyond a quartz, is then 10 ms, half a sampling period at 50 Hz
    imitates=frozenset({"time"}),
    phrase=Phrase(
        "the stamps of {who} drift from those of the commands by {rate} s per second",
        "the sensors",
        "the measurements of {}",
    ),
    nouns={"rate": Noun("rate at which the sensors' clock gains", appears="clock skew", size="rate")},
    not_in_mjcf=READ_ELSEWHERE,
)

SENSOR_LAG = Effect(
    name="sensor_lag",
    stage="sensor",
    port="sensor",
    target="channel",
    parameters=(Parameter("time_constant", "s", 0.0, 0.0, 0.5, (0.01, 0.05), quantity="reading lag"),),
    summary="measurements pass a low-pass",
    site="filter",
    phrase=Phrase("{who} follow with a time constant of {time_constant}", "the measurements", "the measurements of {}"),
    nouns={"time_constant": Noun("time constant of the measurements", targeted="sensor time constant")},
    not_in_mjcf=READ_ELSEWHERE,
)

SENSOR_SCALE = Effect(
    name="sensor_scale",
    stage="sensor",
    port="sensor",
    target="channel",
    parameters=(Parameter("scale", "1", 1.0, 0.2, 5.0, (1.1,), tolerance=0.002, quantity="reading scale"),),
    summary="a channel reads a multiple of the truth",
    null_target=False,
    site="range",
    unseen="the channel hardly moves away from its zero",
    imitates=frozenset({"position"}),
    phrase=Phrase("{who} reads {scale} of the true value", shares=("scale",)),
    nouns={"scale": Noun("scale", "factor")},
    not_in_mjcf=READ_ELSEWHERE,
)

ENCODER_ECCENTRICITY = Effect(
    name="encoder_eccentricity",
    listed=False,
    stage="sensor",
    port="sensor",
    target="channel",
    parameters=(
        Parameter("amplitude", "rad", 0.0, 0.0, 0.5, (0.03, 0.03, 0.03, 0.03), tolerance=0.002),
        Parameter("phase", "rad", 0.0, -math.inf, math.inf, (0.0, 1.5708, 3.1416, -1.5708), shape=True),
    ),
    summary="an encoder that sits off its shaft's axis errs by a sine of the angle",
    step=off_axis,
    null_target=False,
    site="encoder",
    unseen="the joint covers only a small part of a turn",
    imitates=frozenset({"position"}),
    phrase=Phrase("{who} is off by up to {amplitude} either way, once per turn, as with an off-axis encoder"),
    nouns={"amplitude": Noun("error of the encoder over a turn", "own", "encoder eccentricity", "an", "amplitude")},
    not_in_mjcf=READ_ELSEWHERE,
)

SENSOR_BIAS = Effect(
    name="sensor_bias",
    stage="sensor",
    port="sensor",
    target="channel",
    parameters=(
        Parameter(
            "bias", "channel unit", 0.0, -math.inf, math.inf, (0.03, -0.03), tolerance=0.005, quantity="reading offset"
        ),
    ),
    summary="a constant offset of one channel",
    null_target=False,
    site="offset",
    unseen="the robot hardly drives in the direction that it biases",
    imitates=frozenset({"position"}),
    phrase=Phrase("{who} reads {bias} too high"),
    nouns={"bias": Noun("bias", "excess")},
    not_in_mjcf=READ_ELSEWHERE,
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
    step=mounted,
    undo=unmounted,
    site="point",
    unseen="the robot hardly turns",
    phrase=Phrase("the tracked point sits at ({x}, {y}) in the body frame, not where the model has it"),
    nouns={
        "x": Noun("x coordinate of the tracked point in the body frame", "excess"),
        "y": Noun("y coordinate of the tracked point in the body frame", "excess"),
    },
    not_in_mjcf=READ_ELSEWHERE,
)

SENSOR_OUTLIERS = Effect(
    name="sensor_outliers",
    stage="sensor",
    port="sensor",
    target="robot",
    parameters=(Parameter("rate", "1", 0.0, 0.0, 1.0, ()),),
    summary="samples that jump away",
    site="samples",
    fitted=False,
    phrase=Phrase("{rate} of the samples are outliers", shares=("rate",)),
    nouns={"rate": Noun("share of outliers", appears="outliers", article="")},
    not_in_mjcf=READ_ELSEWHERE,
)

EFFECTS = (
    SENSOR_DELAY, SENSOR_LAG, SENSOR_SCALE, CLOCK_SKEW, SENSOR_BIAS, SENSOR_MOUNTING, SENSOR_OUTLIERS,
    ENCODER_ECCENTRICITY,
)  # fmt: skip
