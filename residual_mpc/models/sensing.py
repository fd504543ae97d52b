"""What the sensors of a robot that is stepped report of what is true: late, low-passed, scaled, offset."""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from residual_mpc.effects.effect import Quantity
from residual_mpc.effects.library import BY_NAME, FACTORS, present
from residual_mpc.effects.ops import NUMPY
from residual_mpc.effects.sensor import ENCODER_ECCENTRICITY, EVERY_SENSOR, lateness, low_pass, off_axis
from residual_mpc.models.settings import Settings

Readings = Mapping[str, np.ndarray]  # channel -> (rows,)

# Channels that count from where a run began: an integrated rate has no zero of its own, so a scale acts on what is
# turned since then.
SINCE_START = ("pose.theta",)
FLATTEST = 0.3  # of a reading's usual slope, the least that it is taken to have
INVERTING = 6  # Newton steps from a reading to the angle behind it, at an amplitude of at most half a radian
SKEWED = 1.0  # s by which a clock makes readings late at most, of a robot that is stepped: bounds the memory


class SensedRobot(Protocol):
    """What of a robot its sensors depend on; see Robot."""

    @property
    def channels(self) -> tuple[str, ...]: ...

    def slots(self, effect: str) -> tuple[str, ...]: ...


def slot_of(channel: str, slots: tuple[str, ...]) -> int | None:
    """Which target of a sensor effect a channel belongs to: itself, its joint, `pose` for the localisation, or
    `sensors` for all of them."""
    kind, _, name = channel.partition(".")
    for i, slot in enumerate(slots):
        if slot in (channel, name, EVERY_SENSOR) or (slot == "pose" and kind in ("pose", "twist")):
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


def swing_of(robot: SensedRobot, settings: Settings, channel: str) -> dict[str, np.ndarray] | None:
    """(rows,) each of the settings, how a channel's encoder sits off its axis; None where it does not."""
    values = settings.effects.get(ENCODER_ECCENTRICITY.name)
    slot = None if values is None else slot_of(channel, robot.slots(ENCODER_ECCENTRICITY.name))
    return None if values is None or slot is None else {k: v[:, slot] for k, v in values.items()}


def scaled(true: np.ndarray, scale: np.ndarray, origin: np.ndarray | float) -> np.ndarray:
    """What a sensor reads that multiplies what lies beyond its origin; the true value itself at a scale of 1."""
    return np.asarray(scale * true + (1.0 - scale) * origin)


def unscaled(reading: np.ndarray, scale: np.ndarray, origin: np.ndarray | float) -> np.ndarray:
    """The true value behind a reading: the inverse of `scaled`."""
    return np.asarray((reading - (1.0 - scale) * origin) / scale)


@dataclass(frozen=True)
class Curve:
    """What a channel reads of true values, delay, low-pass and bias aside. scale, None for 1; origin: what a scale
    leaves alone; swing: the numbers of an encoder off its axis, None where it sits on it. All broadcast over the
    values."""

    scale: np.ndarray | None
    origin: np.ndarray | float
    swing: Mapping[str, np.ndarray] | None

    def read(self, true: np.ndarray) -> np.ndarray:
        plain = true if self.scale is None else scaled(true, self.scale, self.origin)
        return plain if self.swing is None else np.asarray(plain + off_axis(NUMPY, self.swing, true))

    def true(self, reading: np.ndarray) -> np.ndarray:
        """The values behind readings, by Newton's method where an encoder is off its axis."""
        true = reading if self.scale is None else unscaled(reading, self.scale, self.origin)
        for _ in range(INVERTING if self.swing is not None else 0):
            true = true - (self.read(true) - reading) / self.slope(true)
        return true

    def slope(self, true: np.ndarray) -> np.ndarray | float:
        """How fast the readings change with the true values; at least FLATTEST of what they do on the axis, where an
        encoder that turns back could mean several angles."""
        plain: np.ndarray | float = 1.0 if self.scale is None else self.scale
        if self.swing is None:
            return plain
        bent = plain + self.swing["amplitude"] * np.cos(true + self.swing["phase"])
        return np.asarray(np.maximum(bent, FLATTEST * plain))


def mounted_at(settings: Settings, true: Readings) -> dict[str, np.ndarray]:
    """The channels (rows,) with the position of the tracked point."""
    out = dict(true)
    posed = {"pose.x", "pose.y", "pose.theta"} <= set(out)
    for effect, values in present(settings.effects, "point") if posed else ():
        assert effect.step is not None
        p = {k: v[:, 0] for k, v in values.items()}
        out["pose.x"], out["pose.y"] = effect.step(NUMPY, p, out["pose.x"], out["pose.y"], out["pose.theta"])
    return out


def sensed(robot: SensedRobot, settings: Settings, true: Readings, first: Readings) -> dict[str, np.ndarray]:
    """Scale, eccentricity and bias on channels (rows,) of the tracked point. first: the true values with which the run
    began."""
    out = dict(true)
    for channel, value in out.items():
        scale = sensor_value(robot, settings, "reading scale", channel)
        origin = first[channel] if channel in SINCE_START else 0.0
        out[channel] = value = Curve(scale, origin, swing_of(robot, settings, channel)).read(value)
        bias = sensor_value(robot, settings, "reading offset", channel)
        if bias is not None:
            out[channel] = value + bias
    return out


class Saved(NamedTuple):
    """What the next readings depend on: the true values of the latest periods, newest first, what the low-passes gave
    then, the true values of the beginning, and the periods (rows,) since then."""

    line: tuple[Readings, ...]
    slow: tuple[Readings, ...]
    first: Readings
    age: np.ndarray


class Late:
    """Readings on their way: straight between the ends of two periods, and what the run began with before that.

    A clock that gains makes them later and later, up to SKEWED s. One that loses takes back the delay; what is still to
    come it cannot show.
    """

    def __init__(self, robot: SensedRobot, settings: Settings, period: float) -> None:
        self._robot, self._settings = robot, settings
        delays, skews = (_values(robot, settings, q) for q in ("reading delay", "reading skew"))
        zero = np.zeros(settings.rows)
        self._late = {c: delays.get(c, zero) / period for c in delays.keys() | skews.keys()}
        self._skews = skews
        self._age = zero
        longest = max((float(d.max()) for d in self._late.values()), default=0.0) + bool(skews) * SKEWED / period
        self._line: deque[Readings] = deque(maxlen=int(np.ceil(longest)) + 2)  # newest first
        self._slow: deque[Readings] = deque(maxlen=self._line.maxlen)  # newest first
        self._first: Readings = {}
        self._lags = _values(robot, settings, "reading lag")
        self._period = period

    def begin(self, true: Readings) -> None:
        """The low-passes hold what is true."""
        self._line.extend([true] * (self._line.maxlen or 1))
        self._slow.extend([self._behind(true)] * (self._line.maxlen or 1))
        self._first = true
        self._age = np.zeros_like(self._age)

    def push(self, true: Readings) -> None:
        if self._lags:
            before, now = self._behind(self._line[0]), self._behind(true)
            ends = {c: np.stack([before[c], now[c]], axis=-1) for c in now}  # (rows, 2)
            held = self._slow[0]
            self._slow.appendleft({c: self._low_passed(c, x, held[c]) for c, x in ends.items()})
        self._line.appendleft(true)
        self._age = self._age + 1.0

    def _behind(self, true: Readings) -> Readings:
        """What enters the low-passes."""
        there = mounted_at(self._settings, true) if self._lags else {}
        return {c: x for c, x in there.items() if c in self._lags}

    def _low_passed(self, channel: str, x: np.ndarray, held: np.ndarray) -> np.ndarray:
        """(rows,) a period later, from the input's ends (rows, 2)."""
        taus = self._lags[channel]
        return np.array([low_pass(x[i], held[i], float(tau), self._period)[1] for i, tau in enumerate(taus)])

    def read(self) -> dict[str, np.ndarray]:
        """channel -> (rows,)"""
        there = mounted_at(self._settings, self._arrived(self._line))
        if self._lags:
            there |= self._arrived(self._slow)
        return sensed(self._robot, self._settings, there, self._first)

    def _arrived(self, line: deque[Readings]) -> dict[str, np.ndarray]:
        """The channels of a line, each as late as it is."""
        now = dict(line[0])
        for channel in now.keys() & self._late.keys():
            late = self._late[channel]
            if channel in self._skews:
                gained = lateness(self._skews[channel], self._age)
                late = np.clip(late + gained, 0.0, late + SKEWED / self._period)
            past = np.stack([then[channel] for then in line])  # (n, rows)
            whole = np.minimum(late.astype(int), len(past) - 2)
            row = np.arange(past.shape[1])
            part = late - whole
            now[channel] = (1.0 - part) * past[whole, row] + part * past[whole + 1, row]
        return now

    def save(self) -> Saved:
        return Saved(tuple(self._line), tuple(self._slow), self._first, self._age)

    def restore(self, saved: Saved, rows: np.ndarray) -> None:
        """Go back to what `save` gave in the rows of the mask (rows,)."""

        def back(old: Readings, new: Readings) -> Readings:
            return {c: np.where(rows, old[c], new[c]) for c in old}

        for line, before in ((self._line, saved.line), (self._slow, saved.slow)):
            now = list(line)
            line.clear()
            line.extend(back(old, new) for old, new in zip(before, now, strict=True))
        self._first = back(saved.first, self._first)
        self._age = np.where(rows, saved.age, self._age)


def _values(robot: SensedRobot, settings: Settings, quantity: Quantity) -> dict[str, np.ndarray]:
    """channel -> (rows,) where the sensor effects change the quantity of its readings."""
    found = {c: sensor_value(robot, settings, quantity, c) for c in robot.channels}
    return {c: x for c, x in found.items() if x is not None and x.any()}
