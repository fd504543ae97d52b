"""The robots of the scenarios: a two-wheeled robot in a physics engine, with what is withheld from its model."""

from dataclasses import dataclass

import numpy as np

from plants.sensors import Sensed, Sensor
from plants.simulator import Plant, Reading, Simulator
from plants.wheeled.motions import Reference, back_and_forth, figure_eight, route, spin_in_place
from plants.wheeled.simulators import bullet_drive, mujoco_drive
from plants.wheeled.twin import Withheld, encoders, twin

# Localisation at every sample; the spikes of a camera are tried elsewhere
LOCALISATION = Sensor({"pose.x": 0.002, "pose.y": 0.002, "pose.theta": 0.006})


def in_mujoco(withheld: Withheld) -> Sensed:
    """The real robot in MuJoCo."""
    return twin(mujoco_drive(), withheld, (LOCALISATION, encoders()))


def in_pybullet(withheld: Withheld) -> Sensed:
    """The real robot in PyBullet."""
    return twin(bullet_drive(), withheld, (LOCALISATION, encoders()))


@dataclass(frozen=True)
class DelayedCommands:
    """A robot that hears its commands `delay` s late, over a slow radio link."""

    inner: Simulator
    delay: float  # s

    @property
    def name(self) -> str:
        return self.inner.name

    @property
    def actuators(self) -> tuple[str, ...]:
        return self.inner.actuators

    @property
    def channels(self) -> tuple[str, ...]:
        return self.inner.channels

    def start(self, rng: np.random.Generator, at: Reading) -> Plant:
        return _LatePlant(self.inner.start(rng, at), self.delay, len(self.inner.actuators))


class _LatePlant:
    """A leaf: the commands that are still on their way."""

    def __init__(self, inner: Plant, delay: float, actuators: int) -> None:
        self._inner, self._delay = inner, delay
        self._sent: list[tuple[float, np.ndarray]] = []
        self._heard = np.zeros(actuators)

    @property
    def time(self) -> float:
        return self._inner.time

    def measure(self) -> Reading:
        return self._inner.measure()

    def truth(self) -> Reading:
        return self._inner.truth()

    def step(self, command: np.ndarray, dt: float) -> None:
        self._sent.append((self.time + self._delay, np.array(command, dtype=np.float64)))
        end = self.time + dt
        while self.time < end - 1e-9:
            while self._sent and self._sent[0][0] <= self.time + 1e-9:
                self._heard = self._sent.pop(0)[1]
            until = min(end, self._sent[0][0]) if self._sent else end
            self._inner.step(self._heard, until - self.time)

    def close(self) -> None:
        self._inner.close()


@dataclass(frozen=True)
class SmoothStart:
    """A motion whose clock starts slowly, within `ramp` s, so that a robot that stands can follow it from the start."""

    inner: Reference
    ramp: float = 2.0

    def path(self, t: np.ndarray) -> np.ndarray:
        """(n, 3) poses at t (n,) s."""
        warped = np.where(t < self.ramp, t * t / (2 * self.ramp), t - 0.5 * self.ramp)
        return self.inner.path(warped)


def brisk_eight() -> SmoothStart:
    """The figure-eight in 12 s: fast enough for lags and wrong widths to show."""
    return SmoothStart(figure_eight(1.0, 12.0))


# What the nominal controller drives for the log: turns, straights, both ways
TRAINING_MOTIONS = (
    (brisk_eight, 24.0),
    (lambda: SmoothStart(route()), 24.0),
    (lambda: SmoothStart(spin_in_place()), 16.0),
    (lambda: SmoothStart(back_and_forth()), 16.0),
)
