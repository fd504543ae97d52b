"""Sensor noise of the generators: white, coloured, quantised, with outliers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.findings.motions import Array, Rng


@dataclass(frozen=True)
class PoseNoise:
    """White noise and AR(1) noise with coefficient `rho` from sample to sample; stationary sigmas in m and rad."""

    white: float = 0.0
    white_heading: float = 0.0
    coloured: float = 0.0
    coloured_heading: float = 0.0
    rho: float = 0.0

    def __post_init__(self) -> None:
        if not 0 <= self.rho < 1:
            raise ValueError(f"rho must be in [0, 1), got {self.rho}")

    def added(self, rng: Rng, pose: Array) -> Array:
        """The pose (samples, 3) as the sensor reports it."""
        sigma = np.array([self.white, self.white, self.white_heading])
        wander = np.array([self.coloured, self.coloured, self.coloured_heading])
        return np.asarray(pose + sigma * rng.standard_normal(pose.shape) + wander * ar1(rng, pose.shape, self.rho))


def ar1(rng: Rng, shape: tuple[int, ...], rho: float) -> Array:
    """Stationary AR(1) noise of unit variance along the first axis."""
    from scipy.signal import lfilter

    fresh = rng.standard_normal(shape)
    fresh[1:] *= np.sqrt(1 - rho**2)
    return np.asarray(lfilter([1.0], [1.0, -rho], fresh, axis=0))


def quantised(values: Array, step: float) -> Array:
    """Rounded to multiples of `step`; 0 leaves them."""
    return np.round(values / step) * step if step else values


def with_outliers(rng: Rng, pose: Array, share: float, jump: float = 0.3) -> Array:
    """A `share` of the samples jumps by some tenths (m, rad)."""
    struck = rng.random(len(pose)) < share
    return np.where(struck[:, None], pose + jump * rng.standard_normal(pose.shape), pose)
