"""The real robot where there is none: the other engine, with effects that no learner is told of, seen by a camera.

What is withheld is drawn from a generator and stays in `Withheld`; only scoring opens it. Runs and robot file of a twin
hold the nominal figures and nothing else.
"""

from dataclasses import asdict, dataclass, replace

import numpy as np

from plants.sensors import Sensed, Sensor
from plants.wheeled.drive import WheeledDrive
from plants.wheeled.engines.geometry import Geometry, Slips
from plants.withheld_effects import Named, named, records
from residual_mpc.effects.actuator import ACTUATOR_LAG
from residual_mpc.effects.contact import TRACK_WIDTH, WHEEL_RADIUS_MISMATCH

FRAME = 1.0 / 30.0  # s, of the camera over the floor


@dataclass(frozen=True)
class Withheld:
    """What differs from the nominal robot; the defaults differ in nothing."""

    ratio: float = 1.0  # right wheel's radius over the left one's
    track: float = 1.0  # effective track over the nominal one
    lag: float = 0.0  # s, of both motors
    static: float = 0.0  # N m, of the sticking wheel's bearing
    kinetic: float = 0.0  # N m
    sticking: int = 0  # the wheel that sticks: 0 left, 1 right
    slips: Slips = Slips()

    def effects(self) -> Named:
        """Those that the library has."""
        return named((WHEEL_RADIUS_MISMATCH, self.ratio), (TRACK_WIDTH, self.track), (ACTUATOR_LAG, self.lag))

    def truth(self) -> dict[str, object]:
        """For scoring alone: the effects of the library by name, the causes that it has no name for, every figure."""
        unnamed = ["a wheel that sticks in its bearing"] if self.static or self.kinetic else []
        unnamed += ["slippery patches"] if self.slips.rate else []
        return {"effects": records(self.effects()), "unknown": unnamed, "figures": asdict(self)}

    def applied(self, nominal: Geometry) -> Geometry:
        """The robot as it really is. A larger wheel stands on the same ground: the chassis tilts."""
        left, right = (replace(w, lag=self.lag) for w in nominal.wheels)
        right = replace(right, radius=right.radius * self.ratio)
        wheels = [left, right]
        wheels[self.sticking] = replace(wheels[self.sticking], static=self.static, kinetic=self.kinetic)
        return replace(nominal, left=wheels[0], right=wheels[1], track=nominal.track * self.track)


def draw_withheld(rng: np.random.Generator) -> Withheld:
    """A robot of low-cost parts: sizes a few per cent off, slow motors, one sticking wheel, slippery patches."""
    ratio = 1.0 + rng.choice([-1.0, 1.0]) * rng.uniform(0.02, 0.05)
    track = 1.0 + rng.choice([-1.0, 1.0]) * rng.uniform(0.03, 0.08)
    kinetic = rng.uniform(0.01, 0.03)
    return Withheld(
        float(ratio),
        float(track),
        float(rng.uniform(0.05, 0.12)),
        float(kinetic * rng.uniform(1.5, 2.5)),
        float(kinetic),
        int(rng.integers(2)),
        Slips(rate=float(rng.uniform(0.05, 0.15))),
    )


def camera(spikes: float = 0.05) -> Sensor:
    """Tags on the robot seen from above: pose and world twist at 30 Hz; spikes: wrong estimates a second."""
    sigma = {"pose.x": 0.002, "pose.y": 0.002, "pose.theta": 0.006}
    sigma |= {"twist.x": 0.02, "twist.y": 0.02, "twist.theta": 0.06}
    size = {"pose.x": 0.2, "pose.y": 0.2, "pose.theta": 0.6, "twist.x": 1.0, "twist.y": 1.0, "twist.theta": 3.0}
    return Sensor(sigma, FRAME, spikes, size, loss=0.01)


def encoders() -> Sensor:
    """Wheel speeds at every reading."""
    return Sensor({"velocity.left": 0.03, "velocity.right": 0.03})


def twin(simulator: WheeledDrive, withheld: Withheld, sensors: tuple[Sensor, ...] = (camera(), encoders())) -> Sensed:
    """The nominal `simulator` (of the engine that is not the model's) turned into the robot that it really is."""
    real = replace(simulator, name="two_wheels", geometry=withheld.applied(simulator.geometry), slips=withheld.slips)
    return Sensed(real, sensors)


def noisy(simulator: WheeledDrive) -> Sensed:
    """A simulator as it is, under sensor noise without spikes: the paper's Webots."""
    return Sensed(simulator, (replace(camera(spikes=0.0), spike=None, loss=0.0), encoders()))
