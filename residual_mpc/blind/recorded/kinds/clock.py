"""Changes of the clocks, put into the stamps: no value is interpolated."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from residual_mpc.blind.recorded.half import Half
from residual_mpc.blind.recorded.kinds.kind import Kind, Sizes, Target, between, refuse, signed
from residual_mpc.blind.recorded.log import FloatArray, Log, period_of
from residual_mpc.effects.command import COMMAND_DELAY
from residual_mpc.effects.sensor import CLOCK_SKEW, SENSOR_DELAY
from residual_mpc.logs.columns import member

DRIVES = "diff_drive"
LATEST = 0.25  # s, of a delay: no loop that still works is later
FASTEST = 0.02  # of a skew: a quartz is off by 1e-4 at most, a timer whose divider is rounded by some per cent


def _all_measured(half: Half) -> tuple[str, ...]:
    """The channels of the sensors whose clock moves: a pose without the wheels' encoders, or whatever there is."""
    whole = tuple(c for c in half.measured if c.startswith(("pose.", "twist.")))
    return whole or half.measured


def _sensor_targets(half: Half) -> tuple[Target, ...]:
    if not half.measured:
        raise refuse(SENSOR_DELAY.name, "no column is measured in every run")
    if half.plant == DRIVES or any(c.startswith("pose.") for c in half.measured):
        return ("pose",) if "pose.x" in half.measured else (None,)
    return (None, *half.joints) if len(half.joints) > 1 else (None,)


def _columns(half: Half, target: Target) -> tuple[str, ...]:
    if target in (None, "pose"):
        return _all_measured(half)
    return tuple(c for c in half.measured if member(c) == target)


def _lateness(half: Half, columns: tuple[str, ...], strength: float) -> float:
    """s. On a regular log it is whole samples, so that the moved samples fall into rows that are there."""
    position = tuple(c for c in columns if c.startswith(("pose.", "position."))) or columns
    period, regular = period_of(half.logs)
    pace = half.pace(position)
    least = max(0.02 * pace, period)
    most = max(min(max(0.4 * pace, 5.0 * least), LATEST), least)
    delay = between(least, most, strength)
    return round(delay / period) * period if regular else delay


def _sensor_delay(half: Half, target: Target, strength: float, rng: np.random.Generator) -> Sizes:
    return {"delay": _lateness(half, _columns(half, target), strength)}


def _restamp(columns: Callable[[Log], tuple[str, ...]], change: Callable[[FloatArray], FloatArray], half: Half) -> Half:
    """Columns that shared their stamps share the new ones."""

    def moved(log: Log) -> Log:
        new: dict[int, FloatArray] = {}
        return log.with_stamps(columns(log), lambda t: new.setdefault(id(t), change(t)))

    return half.with_logs(moved)


def _delay_sensors(half: Half, target: Target, sizes: Sizes, rng: np.random.Generator) -> Half:
    late = _columns(half, target)
    return _restamp(lambda log: late, lambda t: t + sizes["delay"], half)


def _command_targets(half: Half) -> tuple[Target, ...]:
    if not half.actuators:
        raise refuse(COMMAND_DELAY.name, "no command was sent in them, measured columns drive the model")
    return (None, *half.actuators) if len(half.actuators) > 1 else (None,)


def _command_delay(half: Half, target: Target, strength: float, rng: np.random.Generator) -> Sizes:
    return {"delay": _lateness(half, half.measured, strength)}


def _delay_commands(half: Half, target: Target, sizes: Sizes, rng: np.random.Generator) -> Half:
    sent = [f"command.{a}" for a in half.actuators if target in (None, a)]
    return _restamp(lambda log: tuple(sent), lambda t: t - sizes["delay"], half)


def _skew_targets(half: Half) -> tuple[Target, ...]:
    if not half.measured:
        raise refuse(CLOCK_SKEW.name, "no column is measured in every run")
    return (None,)


def _skew(half: Half, target: Target, strength: float, rng: np.random.Generator) -> Sizes:
    # half a run's length away from its middle, the stamps are off by as much as a delay's
    pace = half.pace(tuple(c for c in half.measured if not c.startswith("velocity.")))
    most = min(pace / (0.5 * half.seconds), FASTEST)
    return {"rate": signed(rng) * between(0.05 * most, most, strength)}


def _skew_sensors(half: Half, target: Target, sizes: Sizes, rng: np.random.Generator) -> Half:
    late = _all_measured(half)
    return _restamp(lambda log: late, lambda t: t[0] + (t - t[0]) * (1.0 + sizes["rate"]), half)


DELAYED_SENSORS = Kind(
    SENSOR_DELAY.name, "log",
    "What a sensor reported at t is stamped t + delay; commands keep their stamps. Values are untouched: samples whose "
    "new stamp is within 2 % of a sampling period of a row share that row, the others get rows of their own.",
    "clock", _sensor_targets, _sensor_delay, _delay_sensors, rank=9,
)  # fmt: skip
DELAYED_COMMANDS = Kind(
    COMMAND_DELAY.name, "log",
    "The robot answered a command at its stamp. With the stamp set earlier by the delay, the same answer comes that "
    "much later after sending. Where all commands move, a delay of all sensors is the same log.",
    "clock", _command_targets, _command_delay, _delay_commands, rank=9,
)  # fmt: skip
SKEW = Kind(
    CLOCK_SKEW.name, "log",
    "The sensors' stamps count from each run's first at another rate; no value is touched.",
    "clock", _skew_targets, _skew, _skew_sensors, rank=9,
)  # fmt: skip
