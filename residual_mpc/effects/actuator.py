"""Effects of the actuator itself: how its output (a force; a wheel: its speed) follows the command."""

import math
from typing import Any

import numpy as np

from residual_mpc.effects.effect import Effect, Parameter, Values, no_memory
from residual_mpc.effects.gear import DAMPING_BEHIND
from residual_mpc.effects.ops import Array, Ops, clip
from residual_mpc.effects.phrase import Noun, Phrase
from residual_mpc.effects.ramp import missing, missing_at_end
from residual_mpc.effects.recursion import first_order

TINY = 1e-12  # s: keeps exp(-dt / tau) defined at tau = 0, where it is exactly 0


def lag_start(ops: Ops, p: Values, u: Array, dt: float) -> Array:
    """The actuator has settled on the first command."""
    return u


def lag_step(ops: Ops, p: Values, y: Array, u: Array, dt: float) -> tuple[Array, Array]:
    """tau dy/dt = u - y, exact for a command held over dt: the output is y's mean over the step, the memory y's end."""
    tau = p["time_constant"]
    e = ops.exp(-dt / ops.maximum(tau, TINY))
    mean = u + (y - u) * (tau / dt) * (1.0 - e)
    return mean, u + (y - u) * e


def lag_sequence(p: Values, u: np.ndarray, dt: float) -> np.ndarray:
    """The means of lag_step over a whole sequence at once, for a batch in numpy; it has settled on the first command.

    p (B, nu), u (B, K, nu) -> (B, K, nu).
    """
    tau, out = p["time_constant"], u.copy()
    for value in np.unique(tau[tau > 0]):
        row, actuator = np.nonzero(tau == value)
        line = u[row, :, actuator]  # (n, K)
        e = np.exp(-dt / value)
        end = first_order(e, (1.0 - e) * line, line[:, 0])
        begin = np.concatenate([line[:, :1], end[:, :-1]], axis=1)
        out[row, :, actuator] = line + (begin - line) * (value / dt) * (1.0 - e)
    return out


def lag_end(p: Values, u: np.ndarray, end: np.ndarray, y: np.ndarray, dt: float) -> np.ndarray:
    """What lag_step has come to at the end of each step, from its means y. u is taken to run evenly through its mean to
    its end; of the way from the mean to the end, the share `arrives` has come through by then."""
    tau = np.maximum(p["time_constant"], TINY)
    e = np.exp(-dt / tau)
    arrives = 2.0 - (1.0 - e) * (1.0 + 2.0 * tau / dt)
    return np.asarray(u + (y - u) * e * dt / (tau * (1.0 - e)) + (end - u) * arrives)


def rate_start(ops: Ops, p: Values, u: Array, dt: float) -> Array:
    """The setpoint has arrived at the first command."""
    return u


def rate_step(ops: Ops, p: Values, y: Array, u: Array, dt: float) -> tuple[Array, Array]:
    """y moves towards u at no more than the rate, exact for a command held over dt: the output is y's mean over the
    step, the memory y's end. Written as u less what is missing, which at an infinite rate is u to the last bit."""
    mean, end = missing(ops, u - y, p["rate"], dt)
    return u - mean, u - end


def rate_end(p: Values, u: np.ndarray, end: np.ndarray, y: np.ndarray, dt: float) -> np.ndarray:
    """What rate_step has come to at the end of each step, from its means y; where it has not limited, the end of u."""
    return np.asarray(np.where(y == u, end, u - missing_at_end(u - y, p["rate"], dt)))


def gain_step(ops: Ops, p: Values, memory: Any, y: Array, clock: Array, dt: float) -> tuple[Array, Any]:
    """gain * y."""
    return p["gain"] * y, memory


def sag_step(ops: Ops, p: Values, memory: Any, y: Array, clock: Array, dt: float) -> tuple[Array, Any]:
    """(1 - rate * time since the run began) * y; never below zero."""
    return ops.maximum(1.0 - p["rate"] * clock, 0.0) * y, memory


def saturation_step(ops: Ops, p: Values, memory: Any, y: Array, clock: Array, dt: float) -> tuple[Array, Any]:
    """y held within +-limit."""
    return clip(ops, y, -p["limit"], p["limit"]), memory


SLOWEST = 1e-6  # of the stall torque: keeps an infinite one infinite at the no-load speed


def line_limits(ops: Ops, p: Values, w: Array) -> tuple[Array, Array]:
    """Lowest and highest output at speed w: stall (1 - |w| / no_load) in the direction of the motion (a DC motor at its
    supply voltage: Fitzgerald, Kingsley and Umans, Electric Machinery, 2003, section 7.4), stall against it.
    """
    share = w / p["no_load_speed"]
    high = p["stall_torque"] * clip(ops, 1.0 - share, SLOWEST, 1.0)
    return -p["stall_torque"] * clip(ops, 1.0 + share, SLOWEST, 1.0), high


def backlash_start(ops: Ops, p: Values, w: Array) -> Array:
    """Motor angle minus wheel angle, rad: the play rests on the stop that the motion pushes against."""
    return 0.5 * p["gap"] * ops.sign(w)


def backlash_step(ops: Ops, p: Values, x: Array, w: Array, clock: Array, dt: float) -> tuple[Array, Array]:
    """The play operator (Brokate and Sprekels, Hysteresis and Phase Transitions, 1996, eq. 2.1.5) on the angle.

    x is motor minus wheel angle in [-gap/2, gap/2]; the wheel moves only while the motor pushes against a stop.
    """
    half = 0.5 * p["gap"]
    x_next = clip(ops, x + w * dt, -half, half)
    return w - (x_next - x) / dt, x_next


ACTUATOR_LAG = Effect(
    name="actuator_lag",
    stage="actuator",
    port="command",
    target="actuator",
    parameters=(
        Parameter(
            "time_constant", "s", 0.0, 0.0, 3.0, (0.02, 0.06, 0.15, 0.35), tolerance=0.02, quantity="command lag"
        ),
    ),
    summary="the actuator follows its command like a first-order system",
    start=lag_start,
    step=lag_step,
    rank=90,
    inertial=True,
    sequence=lag_sequence,
    at_end=lag_end,
    label="lag",
    phrase=Phrase("{who} follows its command with a lag of {time_constant}"),
    nouns={"time_constant": Noun("actuator lag", article="an", targeted="lag")},
)

ACTUATOR_GAIN = Effect(
    name="actuator_gain",
    stage="actuator",
    port="output",
    target="actuator",
    parameters=(Parameter("gain", "1", 1.0, 0.002, 5.0, (0.04, 0.2, 0.6, 0.85, 1.2), tolerance=0.01),),
    summary="the actuator gives a multiple of what the model expects",
    start=no_memory,
    step=gain_step,
    site="strength",
    rank=10,
    timed=False,
    steady=True,
    imitates=frozenset({"time", "position", "speed", "load"}),
    # not of the load: a gain changes what that is a law of; a torque in proportion to that which is commanded is a gain
    laws=(("strength", "time", "constant"), ("strength", "position", "constant"), ("torque", "command", "line")),
    interchangeable="rim speed",
    phrase=Phrase("{who} delivers {gain} of its modelled output", shares=("gain",)),
    nouns={"gain": Noun("actuator gain", "factor", targeted="gain")},
)

SATURATION = Effect(
    name="saturation",
    stage="actuator",
    port="output",
    target="actuator",
    parameters=(
        Parameter(
            "limit",
            "actuator unit",
            math.inf,
            0.0,
            math.inf,
            (0.96, 0.88, 0.77, 0.64, 0.5, 0.35, 0.22, 0.12),
            "output",
            True,
            most=1.2,
        ),
    ),
    summary="the actuator's output stops at a limit that the model lacks or has too low",
    start=no_memory,
    step=saturation_step,
    site="limit",
    rank=30,
    timed=False,
    steady=True,
    kink="signal",
    imitates=frozenset({"load"}),
    unseen="no command near the actuator's limit",
    phrase=Phrase("the {quantity} of {who} saturates at {limit}"),
    nouns={"limit": Noun("output limit", article="an")},
)

VOLTAGE_SAG = Effect(
    name="voltage_sag",
    stage="actuator",
    port="output",
    target="actuator",
    parameters=(Parameter("rate", "1/s", 0.0, 0.0, 0.2, (0.002, 0.01), tolerance=0.0005),),
    summary="the actuator weakens over each run",
    start=no_memory,
    step=sag_step,
    site="strength",
    rank=20,
    supply=True,
    seconds=8.0,  # an effect of minutes: in short runs it only imitates others
    unseen="the runs are too short for the supply to weaken",
    imitates=frozenset({"time"}),
    phrase=Phrase("the gain of {who} falls by {rate} per second", shares=("rate",)),
    nouns={"rate": Noun("loss of gain")},
    not_in_mjcf="MuJoCo has no actuator whose gain falls with time",
)

BACKLASH = Effect(
    name="backlash",
    stage="actuator",
    port="output",
    target="actuator",
    parameters=(
        Parameter(
            "gap", "rad", 0.0, 0.0, 2.0, (0.03, 0.08, 0.2, 0.5), "play", True, tolerance=0.02, quantity="gear play"
        ),
        DAMPING_BEHIND,
    ),
    summary="play between motor and link",
    start=backlash_start,
    step=backlash_step,
    site="play",
    rank=90,
    timed=False,
    label="play",
    memory_unit="rad",
    kink="step",
    stalls=("gap",),
    unseen="the motion hardly reverses",
    phrase=Phrase(
        "{who} has {gap} of play",
        "every gear",
        "the gear of {}",
        located=", and {where}",
        optional={"damping_behind": "{value} of the joint's friction sits on the link"},
        shares=("damping_behind",),
    ),
    nouns={"gap": Noun("backlash", article="", inside="in")},
    not_in_mjcf="it needs an additional joint behind the motor, which only the built-in simulator has",
)

TORQUE_SPEED_LIMIT = Effect(
    name="torque_speed_limit",
    stage="actuator",
    port="speed",
    target="actuator",
    parameters=(
        Parameter("stall_torque", "N m", math.inf, 0.0, math.inf, (1.3, 0.8), "output", True),
        Parameter("no_load_speed", "rad/s", 100.0, 1e-3, math.inf, (1.3, 2.0), "speed", shape=True),
    ),
    summary="the torque that a motor can add falls with its speed",
    step=line_limits,
    site="speed limit",
    rank=35,
    unseen="no motion that is fast and needs torque at once",
    phrase=Phrase("{who} gives {stall_torque} at standstill and none at {no_load_speed}"),
    nouns={"stall_torque": Noun("stall torque")},
    not_in_mjcf="MuJoCo's force limits do not depend on the speed",
)

RATE_LIMIT = Effect(
    name="rate_limit",
    stage="actuator",
    port="command",
    target="actuator",
    parameters=(
        Parameter("rate", "command unit/s", math.inf, 0.0, math.inf, (4.0, 1.0, 0.3, 0.1), "command/time", True),
    ),
    summary="the setpoint is let through no faster than this",
    start=rate_start,
    step=rate_step,
    at_end=rate_end,
    rank=30,
    label="ramp",
    kink="signal",
    unseen="no command changes so fast that a limit would act",
    phrase=Phrase("{who} follows its command no faster than {rate}"),
    nouns={"rate": Noun("rate limit of the command", appears="limit of the command's rate", size="rate")},
    not_in_mjcf="MuJoCo has no actuator that limits the rate of its command",
)

EFFECTS = (ACTUATOR_LAG, ACTUATOR_GAIN, SATURATION, VOLTAGE_SAG, BACKLASH, TORQUE_SPEED_LIMIT, RATE_LIMIT)
