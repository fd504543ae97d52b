"""Effects between sending a command and the actuator seeing it."""

import math
from typing import Any

import numpy as np

from residual_mpc.effects.effect import Effect, Parameter, Values, no_memory
from residual_mpc.effects.ops import NUMPY, Array, Ops
from residual_mpc.effects.phrase import Noun, Phrase

LONGEST_DELAY = 0.3  # s: longer dead times are a different fault (a lost connection), and cost memory
LONGEST_LEAD = 0.1  # s: half of the slowest log that is worth a diagnosis


def delay_start(ops: Ops, p: Values, u: Array, dt: float) -> tuple[Array, ...]:
    """The delay line, newest first: LONGEST_DELAY of the first command, held."""
    return (u,) * (math.ceil(LONGEST_DELAY / dt) + 1)


def delay_step(ops: Ops, p: Values, memory: tuple[Array, ...], u: Array, dt: float) -> tuple[Array, Any]:
    """u(t - delay), linear between the samples of the line: hat weights, so that it is smooth enough to optimise. A
    negative delay, which only a log can have, is none."""
    line = (u, *memory)
    n = ops.maximum(p["delay"], 0.0) / dt  # the dead time in samples, not an integer
    out = u * ops.maximum(1.0 - n, 0.0)
    for j, past in enumerate(line[1:], start=1):
        out = out + past * ops.maximum(1.0 - ops.absolute(n - j), 0.0)
    return out, line[:-1]


def delay_trim(memory: tuple[Array, ...], p: Values, dt: float) -> tuple[Array, ...]:
    """The line as long as the delays at hand need it."""
    return memory[: max(1, math.ceil(float(np.max(p["delay"])) / dt - 1e-9))]


def delay_sequence(p: Values, u: np.ndarray, dt: float) -> np.ndarray:
    """delay_step over a whole sequence at once, for a batch in numpy.

    p (B, nu), u (B, K, nu) -> (B, K, nu); before its beginning the first command is held, and behind its end the last
    one where the delay is negative: the log then holds fewer commands than were sent.
    """
    delay, out = p["delay"], u.copy()
    step = np.arange(-1, u.shape[1])
    begins = np.flatnonzero(np.concatenate([[True], (delay[1:] != delay[:-1]).any(axis=1)]))
    for begin, end in zip(begins, [*begins[1:], len(delay)], strict=True):  # a hypothesis has one for all its windows
        here = delay[begin]
        alike = here.any() and (here == here[0]).all()
        for actuators in [slice(None)] if alike else [slice(i, i + 1) for i in np.flatnonzero(here)]:
            whole, part = divmod(float(here[actuators][0]) / dt, 1.0)
            moved = u[begin:end, :, actuators].take(np.clip(step - int(whole), 0, u.shape[1] - 1), axis=1)
            out[begin:end, :, actuators] = (1.0 - part) * moved[:, 1:] + part * moved[:, :-1]
    return out


def dead_zone_step(ops: Ops, p: Values, memory: Any, u: Array, dt: float) -> tuple[Array, Any]:
    """0 where |u| < width, else u in full; u is a command, or a position servo's position error."""
    return ops.where(ops.absolute(u) < p["width"], 0.0 * u, u), memory


def dead_zone_sequence(p: Values, u: np.ndarray, dt: float) -> np.ndarray:
    """dead_zone_step over a whole sequence: p (B, nu), u (B, K, nu)."""
    return np.asarray(dead_zone_step(NUMPY, {"width": p["width"][:, None, :]}, (), u, dt)[0])


def rounded_dead_zone(ops: Ops, p: Values, u: Array, eps: float) -> Array:
    """A dead zone whose edge is eps wide, so that its derivative shows the way out: u / (1 + exp(-(|u| - width) /
    eps)).
    """
    away = ops.minimum((p["width"] - (u * u + eps * eps) ** 0.5) / eps, 40.0)  # exp stays finite
    return u / (1.0 + ops.exp(away))


def breakaway_step(ops: Ops, p: Values, memory: Any, u: Array, dt: float) -> tuple[Array, Any]:
    """sgn(u) max(|u| - loss, 0), what a motor makes of a voltage that has to overcome dry friction; u is a command, or
    a position servo's position error."""
    return u - ops.sign(u) * ops.minimum(p["loss"], ops.absolute(u)), memory


def breakaway_sequence(p: Values, u: np.ndarray, dt: float) -> np.ndarray:
    """breakaway_step over a whole sequence: p (B, nu), u (B, K, nu)."""
    return np.asarray(breakaway_step(NUMPY, {"loss": p["loss"][:, None, :]}, (), u, dt)[0])


def rounded_breakaway(ops: Ops, p: Values, u: Array, eps: float) -> Array:
    """breakaway_step with edges eps wide: max(x, 0) is (x + sqrt(x^2 + eps^2)) / 2."""

    def beyond(x: Array) -> Array:
        return 0.5 * (x + (x * x + eps * eps) ** 0.5)

    return beyond(u - p["loss"]) - beyond(-u - p["loss"])


POSITION_ERRORS = "{who} ignores position errors smaller than {width}"

COMMAND_DELAY = Effect(
    name="command_delay",
    stage="command",
    port="command",
    target="actuator",
    parameters=(
        Parameter(
            "delay",
            "s",
            0.0,
            -LONGEST_LEAD,
            LONGEST_DELAY,
            (0.01, 0.03, 0.08, 0.16),
            tolerance=0.005,
            quantity="command delay",
        ),
    ),
    summary="commands reach the actuator late",
    start=delay_start,
    step=delay_step,
    rank=40,  # behind ramps and dead zones, which would react to interpolated commands that were never sent
    sequence=delay_sequence,
    trim=delay_trim,
    label="sent",
    # a motor of higher order adds about a tenth of its lag to a first-order law's as dead time
    shadows=(("command lag", 0.1),),
    phrase=Phrase("{who} take effect {delay} late", "commands", "commands to {}"),
    nouns={"delay": Noun("command delay", targeted="delay")},
)

DEAD_ZONE = Effect(
    name="dead_zone",
    stage="command",
    port="command",
    target="actuator",
    parameters=(
        Parameter(
            "width",
            "command unit",
            0.0,
            0.0,
            math.inf,
            (0.03, 0.06, 0.1, 0.15, 0.22, 0.32, 0.45),
            "command",
            True,
            tolerance=0.03,
            most=0.9,
        ),
    ),
    summary="small commands do nothing",
    start=no_memory,
    step=dead_zone_step,
    rank=20,
    on_error=True,
    sequence=dead_zone_sequence,
    rounded=rounded_dead_zone,
    stalls=("width",),
    unseen="no small commands near which it would act",
    phrase=Phrase(
        "{who} ignores commands smaller than {width}", by_unit={"rad": POSITION_ERRORS, "m": POSITION_ERRORS}
    ),
    nouns={"width": Noun("dead zone", inside="in")},
    not_in_mjcf="MuJoCo has no actuator with a dead zone",
)

BREAKAWAY_LOSS = Effect(
    name="breakaway_loss",
    listed=False,
    stage="command",
    port="command",
    target="actuator",
    parameters=(
        Parameter(
            "loss", "command unit", 0.0, 0.0, math.inf, (0.05, 0.15, 0.4), "command", True, tolerance=0.03, most=0.9
        ),
    ),
    summary="every command loses what it takes to break away, and smaller ones do nothing",
    start=no_memory,
    step=breakaway_step,
    rank=21,
    on_error=True,
    sequence=breakaway_sequence,
    rounded=rounded_breakaway,
    stalls=("loss",),
    unseen="the commands hardly vary",
    phrase=Phrase(
        "{who} loses {loss} of every command and ignores smaller ones",
        by_unit=dict.fromkeys(("rad", "m"), "{who} loses {loss} of every position error and ignores smaller ones"),
    ),
    nouns={"loss": Noun("breakaway loss", article="", inside="in")},
    not_in_mjcf="MuJoCo has no actuator that loses a part of its command",
)

EFFECTS = (COMMAND_DELAY, DEAD_ZONE, BREAKAWAY_LOSS)
