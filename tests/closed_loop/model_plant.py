"""A plant that is an augmented model itself, with sensor noise: the loop can be held against what is known of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from residual_mpc.export import Augmented


@dataclass(frozen=True, eq=False)
class ModelSimulator:
    """noise: 1-sigma of each pose; spikes: share of the readings that are 1 m off; lost: share that is missing."""

    model: Augmented
    noise: tuple[float, float, float] = (0.0, 0.0, 0.0)
    spikes: float = 0.0
    lost: float = 0.0

    @property
    def actuators(self):
        return self.model.stepped.commands

    @property
    def channels(self):
        return self.model.stepped.poses

    def start(self, rng, at):
        return _ModelPlant(self, rng, self.model.start(at))


class _ModelPlant:
    def __init__(self, simulator, rng, x):
        self.simulator, self.rng, self.x = simulator, rng, x

    def truth(self):
        return dict(zip(self.simulator.channels, self.x[:3].tolist(), strict=True))

    def measure(self):
        s = self.simulator
        y = self.x[:3] + np.array(s.noise) * self.rng.standard_normal(3)
        y += np.array([1.0, 0.0, 0.0]) * (self.rng.random() < s.spikes)
        if self.rng.random() < s.lost:
            y[:] = np.nan
        return dict(zip(s.channels, y.tolist(), strict=True))

    def step(self, command, dt):
        assert dt == self.simulator.model.build.dt
        self.x = self.simulator.model.numpy_step(self.x, command)

    def close(self):
        pass


@dataclass(frozen=True)
class Eight:
    """A figure-eight that starts gently."""

    def path(self, t):
        t = np.where(t < 2.0, t * t / 4.0, t - 1.0)
        w = 2 * np.pi / 12.0
        dx, dy = 0.4 * w * np.cos(w * t), 0.4 * w * np.cos(2 * w * t)
        return np.stack([0.4 * np.sin(w * t), 0.2 * np.sin(2 * w * t), np.unwrap(np.arctan2(dy, dx))], axis=-1)
