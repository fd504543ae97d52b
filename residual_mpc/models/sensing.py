"""What a robot's sensors report of what is true: late, offset, from another point; for a robot that is stepped."""

from collections import deque
from collections.abc import Mapping
from typing import Protocol

import numpy as np

from residual_mpc.effects.effect import Quantity
from residual_mpc.effects.library import BY_NAME, present
from residual_mpc.effects.ops import NUMPY
from residual_mpc.models.settings import Settings


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
    """(rows,) of the settings, what the sensor effects add to a quantity of a channel's readings; None where they do
    nothing to it."""
    total: np.ndarray | None = None
    for effect, values in settings.effects.items():
        for p in BY_NAME[effect].parameters:
            slot = slot_of(channel, robot.slots(effect)) if p.quantity == quantity else None
            if slot is not None:
                value = values[p.name][:, slot]
                total = value if total is None else total + value
    return total


def sensed(robot: SensedRobot, settings: Settings, true: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Mounting and bias on channels (rows,); see the order of the stages."""
    out = dict(true)
    posed = {"pose.x", "pose.y", "pose.theta"} <= set(out)
    for effect, values in present(settings.effects, "point") if posed else ():
        assert effect.step is not None
        p = {k: v[:, 0] for k, v in values.items()}
        out["pose.x"], out["pose.y"] = effect.step(NUMPY, p, out["pose.x"], out["pose.y"], out["pose.theta"])
    for channel, value in out.items():
        bias = sensor_value(robot, settings, "reading offset", channel)
        if bias is not None:
            out[channel] = value + bias
    return out


class Late:
    """Readings on their way: straight between the ends of two periods, and what the run began with before that."""

    def __init__(self, robot: SensedRobot, settings: Settings, period: float) -> None:
        self._robot, self._settings = robot, settings
        delays = {c: sensor_value(robot, settings, "reading delay", c) for c in robot.channels}
        self._late = {c: d / period for c, d in delays.items() if d is not None and d.any()}
        longest = max((float(d.max()) for d in self._late.values()), default=0.0)
        self._line: deque[Mapping[str, np.ndarray]] = deque(maxlen=int(np.ceil(longest)) + 2)  # newest first

    def begin(self, true: Mapping[str, np.ndarray]) -> None:
        self._line.extend([true] * (self._line.maxlen or 1))

    def push(self, true: Mapping[str, np.ndarray]) -> None:
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
        return sensed(self._robot, self._settings, now)

    def save(self) -> tuple[Mapping[str, np.ndarray], ...]:
        return tuple(self._line)

    def restore(self, saved: tuple[Mapping[str, np.ndarray], ...], rows: np.ndarray) -> None:
        """Go back to what `save` gave in the rows of the mask (rows,)."""
        now = list(self._line)
        self._line.clear()
        self._line.extend({c: np.where(rows, old[c], new[c]) for c in old} for old, new in zip(saved, now, strict=True))
