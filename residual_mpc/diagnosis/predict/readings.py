"""What each hypothesis makes of one channel's readings: from the true value to the reading and back."""

from dataclasses import dataclass

import numpy as np

from residual_mpc.diagnosis.data.dataset import Block, Dataset
from residual_mpc.effects.sensor import lateness
from residual_mpc.models.sensing import SINCE_START, Curve, sensor_value, swing_of
from residual_mpc.models.settings import Settings


@dataclass(frozen=True)
class LocalValue:
    """A channel's readings near the windows' starts: value, slope (per second) and curvature (per second squared), each
    (H, W); NaN where unmeasured."""

    value: np.ndarray
    slope: np.ndarray
    curvature: np.ndarray


@dataclass(frozen=True)
class Reading:
    """H hypotheses on the W windows of a block: reading(t) = scaled(x) + swing(x) + bias, x = low-pass of true(t -
    late), where late is the delay and what the sensor's clock has gained since the run began.

    delay (H,) s; skew (H, 1), None where no hypothesis has one; clock (W,) s from the run's first stamp to the windows'
    starts; bias (H, 1) channel unit; scale (H, 1), None where no hypothesis scales; origin (H, W): the true value
    that a scale leaves alone, channel unit; lag (H,) s, None where no hypothesis has a low-pass; swing: the numbers of
    an encoder off its axis, (H, 1) each, None where no hypothesis has one.
    """

    delay: np.ndarray
    skew: np.ndarray | None
    clock: np.ndarray
    bias: np.ndarray
    scale: np.ndarray | None
    origin: np.ndarray
    lag: np.ndarray | None
    swing: dict[str, np.ndarray] | None = None

    def late(self, t: np.ndarray) -> np.ndarray:
        """(H, W, M) s, or (H, 1, 1) without a skew: how late readings at t (W, M) s after the windows' starts are."""
        delay = self.delay[:, None, None]
        return delay if self.skew is None else delay + lateness(self.skew[:, :, None], self.clock[:, None] + t)

    def stamp(self, early: np.ndarray) -> np.ndarray:
        """(H, W) s after the windows' starts: the stamps of the readings of what was true `early` (H, W) s before
        these."""
        shift = self.delay[:, None] - early
        return shift if self.skew is None else shift + self.skew * (self.clock + shift)

    def of(self, true: np.ndarray) -> np.ndarray:
        """(H, W, M) readings of true values (H, W, M), delay and low-pass aside."""
        deep = {k: v[:, :, None] for k, v in self.swing.items()} if self.swing is not None else None
        scale = None if self.scale is None else self.scale[:, :, None]
        return np.asarray(Curve(scale, self.origin[:, :, None], deep).read(true) + self.bias[:, :, None])

    def true(self, fit: LocalValue) -> np.ndarray:
        """(H, W) true values behind what is read, delay aside: a low-pass' input is y + lag dy/dt."""
        return self.memory(fit.value if self.lag is None else _ahead(fit.value, fit.slope, self.lag))

    def memory(self, value: np.ndarray) -> np.ndarray:
        """(H, W) what the low-pass holds when its output is read as these values (H, W), in true units."""
        return self._curve.true(value - self.bias)

    def rate(self, fit: LocalValue) -> np.ndarray:
        """(H, W) rates of the true values, per second, behind what is read."""
        rate = fit.slope if self.lag is None else _ahead(fit.slope, fit.curvature, self.lag)
        rate = rate if self.skew is None else rate * (1.0 + self.skew)
        if self.scale is None and self.swing is None:
            return rate
        return np.asarray(rate / self._curve.slope(self.true(fit)))

    @property
    def _curve(self) -> Curve:
        return Curve(self.scale, self.origin, self.swing)


def reading_of(data: Dataset, block: Block, settings: Settings, channel: str) -> Reading:
    """What the hypotheses make of a channel."""
    delay = sensor_value(block.robot, settings, "reading delay", channel)
    skew = sensor_value(block.robot, settings, "reading skew", channel)
    bias = sensor_value(block.robot, settings, "reading offset", channel)
    lag = sensor_value(block.robot, settings, "reading lag", channel)
    scale = sensor_value(block.robot, settings, "reading scale", channel)
    zero = np.zeros(settings.rows)
    offset = (zero if bias is None else bias)[:, None]
    counted = scale is not None and channel in SINCE_START  # from a reading, which the bias has shifted
    origin = _origin(data, block, channel) - offset if counted else zero[:, None]
    late = zero if delay is None else delay
    gained = None if skew is None else skew[:, None]
    found = swing_of(block.robot, settings, channel)
    swing = None if found is None else {k: v[:, None] for k, v in found.items()}
    factor = None if scale is None else scale[:, None]
    return Reading(late, gained, block.drive.clock, offset, factor, origin, lag, swing)


def _ahead(value: np.ndarray, rate: np.ndarray, lag: np.ndarray) -> np.ndarray:
    """value + lag * rate (H, W) where the rate is known and there is a lag (H,)."""
    return np.asarray(np.where(lag[:, None] > 0.0, value + lag[:, None] * np.nan_to_num(rate), value))


def _origin(data: Dataset, block: Block, channel: str) -> np.ndarray:
    """(1, W) channel unit: the reading that a scale leaves alone of what counts from where a run began, its first."""
    run = data.run[block.where]
    origin = np.zeros((1, len(run)))
    for i in np.unique(run):
        signal = data.signals.get((int(i), channel))
        if signal is not None and len(signal.y):
            origin[0, run == i] = signal.y[0]
    return origin
