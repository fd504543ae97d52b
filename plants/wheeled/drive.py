"""The two-wheeled robot in motion, in whichever engine: time, set points, dry friction, slippery patches."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from plants.simulator import Plant, Reading
from plants.wheeled.engines.engine import CHANNELS, Engine, motion_of
from plants.wheeled.engines.geometry import WHEELS, Geometry, Slips
from residual_mpc.errors import BadInput

FOLLOW = 25  # steps after which the heading is looked at: a turn of half a circle in between would be missed
FOREVER = 3600.0  # s for which slippery patches are laid out


@dataclass(frozen=True)
class WheeledDrive:
    """The simulator: wheel speeds (rad/s) in; pose, world twist and encoder speeds out, exactly.

    engine opens the physics engine for a geometry and a step: `MujocoEngine` or `BulletEngine`. step: s, the longest
    that the engine takes.
    """

    name: str
    engine: Callable[[Geometry, float], Engine]
    geometry: Geometry = Geometry()
    slips: Slips = Slips()
    step: float = 0.001
    actuators: tuple[str, ...] = WHEELS
    channels: tuple[str, ...] = CHANNELS

    def start(self, rng: np.random.Generator, at: Reading) -> Plant:
        """Raises BadInput for a channel that this robot does not have."""
        unknown = sorted(set(at) - set(CHANNELS))
        if unknown:
            raise BadInput(
                f"unknown channels in the start: {', '.join(unknown)}", self.name, f"use {', '.join(CHANNELS)}"
            )
        engine = self.engine(self.geometry, self.step)
        engine.place(motion_of(at))
        return _DrivePlant(engine, self.geometry, self.slips.draw(rng, FOREVER), self.slips.grip, self.step)


class _DrivePlant:
    def __init__(self, engine: Engine, geometry: Geometry, patches: np.ndarray, low: float, step: float) -> None:
        self._engine, self._step = engine, step
        self._wheels, self._patches, self._low = geometry.wheels, patches, low
        self._plain = all(w.plain for w in geometry.wheels) and not len(patches)
        self._set_point = np.array(engine.motion().wheel)  # a lag starts from the motion that is there
        self._grip = np.array([w.grip for w in self._wheels])
        self._lag = np.array([w.lag for w in self._wheels])
        self._time, self._theta = 0.0, engine.motion().theta

    @property
    def time(self) -> float:
        return self._time

    def measure(self) -> Reading:
        return self.truth()

    def truth(self) -> Reading:
        """The heading is unwrapped."""
        motion = self._engine.motion()
        turned = (motion.theta - self._theta + np.pi) % (2 * np.pi) - np.pi
        self._theta += float(turned)
        return {**motion.reading(), "pose.theta": self._theta}

    def step(self, command: np.ndarray, dt: float) -> None:
        u = np.asarray(command, dtype=np.float64)
        if u.shape != (2,) or not np.isfinite(u).all():
            raise BadInput(f"a command must be two finite wheel speeds in rad/s, got {command}", "two-wheeled robot")
        n = max(1, int(np.ceil(dt / self._step - 1e-9)))
        h = dt / n
        begin = self._time
        for done in range(0, n, FOLLOW):
            steps = min(FOLLOW, n - done)
            if self._plain:
                self._engine.advance(u, h, steps)
            else:
                for _ in range(steps):
                    self._one(u, h)
                    self._time += h
            self._time = begin + (done + steps) * h
            self.truth()
        self._time = begin + dt

    def _one(self, u: np.ndarray, h: float) -> None:
        self._set_point = u + (self._set_point - u) * np.exp(-h / np.maximum(self._lag, 1e-12))
        speed = self._engine.motion().wheel
        level = [
            w.kinetic + (w.static - w.kinetic) * np.exp(-((s / w.stribeck) ** 2))
            for w, s in zip(self._wheels, speed, strict=True)
        ]
        if any(level):
            self._engine.resist(np.array(level))
        if len(self._patches):
            grip = self._grip.copy()
            on = (self._patches[:, 1] <= self._time) & (self._time < self._patches[:, 2])
            grip[self._patches[on, 0].astype(int)] = self._low
            self._engine.grip(grip)
        self._engine.advance(self._set_point, h, 1)

    def close(self) -> None:
        self._engine.close()
