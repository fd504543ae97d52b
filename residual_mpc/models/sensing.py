"""What the sensors of a robot that is stepped report of what is true: late, scaled, offset, from another point."""

from collections import deque
from collections.abc import Mapping
from typing import NamedTuple, Protocol

import numpy as np

from residual_mpc.effects.effect import Quantity
from residual_mpc.effects.library import BY_NAME, FACTORS, present
from residual_mpc.effects.ops import NUMPY
from residual_mpc.models.settings import Settings

Readings = Mapping[str, np.ndarray]  # channel -> (rows,)

# Channels that count from where a run began: an integrated rate has no zero of its own, so a scale acts on what is
# turned since then.
SINCE_START = ("pose.theta",)


class SensedRobot(Protocol):
    """What of a robot its sensors depend on; see Robot."""

    @property
    def channels(self) -> tuple[str, ...]: ...

    def slots(self, effect: str) -> tuple[str, ...]: ...


def slot_of(channel: str, slots: tuple[str, ...]) -> int | None:
    """Which target of a sensor effect a channel belongs to: itself, its joint, or `pose` for the localisation."""
    kind, _, name = channel.partition(".")
    for i, slot in enumerate(slots):
        if slot in (channel, name) or (slot == "pose" and kind in ("pose", "twist")):
            return i
    return None


def sensor_value(robot: SensedRobot, settings: Settings, quantity: Quantity, channel: str) -> np.ndarray | None:
    """(rows,) of the settings, what the sensor effects make of a quantity of a channel's readings: the product of its
    factors, or the sum of what is added; None where they do nothing to it."""
    total: np.ndarray | None = None
    for effect, values in settings.effects.items():
        for p in BY_NAME[effect].parameters:
            slot = slot_of(channel, robot.slots(effect)) if p.quantity == quantity else None
            if slot is not None:
                value = values[p.name][:, slot]
                total = value if total is None else total * value if quantity in FACTORS else total + value
    return total


def scaled(true: np.ndarray, scale: np.ndarray, origin: np.ndarray | float) -> np.ndarray:
    """What a sensor reads that multiplies what lies beyond its origin; the true value itself at a scale of 1."""
    return np.asarray(scale * true + (1.0 - scale) * origin)


def unscaled(reading: np.ndarray, scale: np.ndarray, origin: np.ndarray | float) -> np.ndarray:
    """The true value behind a reading: the inverse of `scaled`."""
    return np.asarray((reading - (1.0 - scale) * origin) / scale)


def sensed(robot: SensedRobot, settings: Settings, true: Readings, first: Readings) -> dict[str, np.ndarray]:
    """Mounting, scale and bias on channels (rows,), in this order. first: the true values with which the run began."""
    out = dict(true)
    posed = {"pose.x", "pose.y", "pose.theta"} <= set(out)
    for effect, values in present(settings.effects, "point") if posed else ():
        assert effect.step is not None
        p = {k: v[:, 0] for k, v in values.items()}
        out["pose.x"], out["pose.y"] = effect.step(NUMPY, p, out["pose.x"], out["pose.y"], out["pose.theta"])
    for channel, value in out.items():
        scale = sensor_value(robot, settings, "reading scale", channel)
        if scale is not None:
            out[channel] = value = scaled(value, scale, first[channel] if channel in SINCE_START else 0.0)
        bias = sensor_value(robot, settings, "reading offset", channel)
        if bias is not None:
            out[channel] = value + bias
    return out


class Saved(NamedTuple):
    """What the next readings depend on: the true values of the latest periods, newest first, and of the beginning."""

    line: tuple[Readings, ...]
    first: Readings


class Late:
    """Readings on their way: straight between the ends of two periods, and what the run began with before that."""

    def __init__(self, robot: SensedRobot, settings: Settings, period: float) -> None:
        self._robot, self._settings = robot, settings
        delays = {c: sensor_value(robot, settings, "reading delay", c) for c in robot.channels}
        self._late = {c: d / period for c, d in delays.items() if d is not None and d.any()}
        longest = max((float(d.max()) for d in self._late.values()), default=0.0)
        self._line: deque[Readings] = deque(maxlen=int(np.ceil(longest)) + 2)  # newest first
        self._first: Readings = {}

    def begin(self, true: Readings) -> None:
        self._line.extend([true] * (self._line.maxlen or 1))
        self._first = true

    def push(self, true: Readings) -> None:
        self._line.appendleft(true)

    def read(self) -> dict[str, np.ndarray]:
        """channel -> (rows,)"""
        now = dict(self._line[0])
        for channel, late in self._late.items():
            past = np.stack([then[channel] for then in self._line])  # (n, rows)
            whole = np.minimum(late.astype(int), len(past) - 2)
            row = np.arange(past.shape[1])
            part = late - whole
            now[channel] = (1.0 - part) * past[whole, row] + part * past[whole + 1, row]
        return sensed(self._robot, self._settings, now, self._first)

    def save(self) -> Saved:
        return Saved(tuple(self._line), self._first)

    def restore(self, saved: Saved, rows: np.ndarray) -> None:
        """Go back to what `save` gave in the rows of the mask (rows,)."""

        def back(old: Readings, new: Readings) -> Readings:
            return {c: np.where(rows, old[c], new[c]) for c in old}

        now = list(self._line)
        self._line.clear()
        self._line.extend(back(old, new) for old, new in zip(saved.line, now, strict=True))
        self._first = back(saved.first, self._first)
