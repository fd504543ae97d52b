"""Sensors between a simulated robot and its log: noise, a sample rate of their own, spikes, dropouts."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from plants.simulator import Plant, Reading, Simulator
from residual_mpc.errors import BadInput


@dataclass(frozen=True)
class Sensor:
    """Channels that are sampled together (a camera's pose, an encoder pair); the defaults are a perfect sensor.

    sigma: of white noise, by channel, channel unit. spike: size of a wrong estimate, by channel, channel unit: a
    spiked sample is off by up to this much, either way. spikes: mean number of them a second. period: s between new
    samples, 0 for one at every reading; in between the channels are NaN. loss: share of the samples that is missing.
    """

    sigma: Mapping[str, float]
    period: float = 0.0
    spikes: float = 0.0
    spike: Mapping[str, float] | None = None
    loss: float = 0.0

    def __post_init__(self) -> None:
        sizes = (*self.sigma.values(), self.period, self.spikes, *(self.spike or {}).values())
        if not all(np.isfinite(s) and s >= 0 for s in sizes) or not 0 <= self.loss < 1:
            raise BadInput(f"sizes must be finite and >= 0, loss in [0, 1), got {self}", "sensor")
        if set(self.spike or {}) - set(self.sigma):
            raise BadInput(
                f"channels with outliers must have a sigma, got {self}", "sensor", "set their sigma, 0 for none"
            )
        if self.spikes and not self.spike:
            raise BadInput("a rate of outliers needs their size", "sensor", "set `spike` for each channel")


@dataclass(frozen=True)
class Sensed:
    """A simulator seen through sensors. Channels without a sensor are left out of what is measured."""

    inner: Simulator
    sensors: tuple[Sensor, ...]

    def __post_init__(self) -> None:
        wanted = [c for s in self.sensors for c in s.sigma]
        unknown = sorted(set(wanted) - set(self.inner.channels))
        if unknown or len(set(wanted)) != len(wanted):
            raise BadInput(
                f"sensors must report each of {', '.join(self.inner.channels)} at most once, got {wanted}",
                self.inner.name,
            )

    @property
    def name(self) -> str:
        return self.inner.name

    @property
    def actuators(self) -> tuple[str, ...]:
        return self.inner.actuators

    @property
    def channels(self) -> tuple[str, ...]:
        sensed = {c for s in self.sensors for c in s.sigma}
        return tuple(c for c in self.inner.channels if c in sensed)

    def start(self, rng: np.random.Generator, at: Reading) -> Plant:
        inner_rng, own_rng = rng.spawn(2)  # the robot does the same, whatever its sensors are
        return _SensedPlant(self.inner.start(inner_rng, at), self.channels, self.sensors, own_rng)


class _SensedPlant:
    """A leaf: the plant, and when each sensor last reported."""

    def __init__(
        self, inner: Plant, channels: tuple[str, ...], sensors: tuple[Sensor, ...], rng: np.random.Generator
    ) -> None:
        self._inner, self._channels, self._sensors, self._rng = inner, channels, sensors, rng
        self._taken = [-1] * len(sensors)  # number of each sensor's latest sample
        self._seen = [-1.0] * len(sensors)  # s, time of its latest reading: how many spikes to expect since

    @property
    def time(self) -> float:
        return self._inner.time

    def measure(self) -> Reading:
        exact = self._inner.measure()
        out = dict.fromkeys(self._channels, float("nan"))
        for i, sensor in enumerate(self._sensors):
            out.update(self._report(i, sensor, exact))
        return out

    def _report(self, i: int, sensor: Sensor, exact: Reading) -> dict[str, float]:
        now, rng = self._inner.time, self._rng
        if sensor.period:
            number = int(now / sensor.period + 1e-6)
            if number == self._taken[i]:
                return {}
            self._taken[i] = number
        since = now - self._seen[i] if self._seen[i] >= 0 else 0.0
        self._seen[i] = now
        noise, lost, hit = rng.standard_normal(len(sensor.sigma)), rng.random(), rng.random()
        jump = rng.uniform(-1.0, 1.0, len(sensor.sigma))  # drawn always, so that one setting moves no other
        if lost < sensor.loss:
            return {}
        spiked = hit < -np.expm1(-sensor.spikes * since)
        spike = sensor.spike or {}
        return {
            c: exact[c] + sigma * float(noise[k]) + (spike.get(c, 0.0) * float(jump[k]) if spiked else 0.0)
            for k, (c, sigma) in enumerate(sensor.sigma.items())
        }

    def truth(self) -> Reading:
        exact = self._inner.truth()
        return {c: exact[c] for c in self._channels}

    def step(self, command: np.ndarray, dt: float) -> None:
        self._inner.step(command, dt)

    def close(self) -> None:
        self._inner.close()
