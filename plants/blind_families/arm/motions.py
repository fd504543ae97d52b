"""What an arm is told to do: joint references (n, joints) rad away from home, at times (n,) s."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Motion = Callable[[Array, int, np.random.Generator], Array]


def _ease(t: Array) -> Array:
    """Rises from 0 to 1 in the first second, without a jump."""
    s = np.clip(t, 0.0, 1.0)
    return np.asarray(s * s * (3 - 2 * s))[:, None]


def multisine(t: Array, joints: int, rng: np.random.Generator) -> Array:
    """Every joint at once, five frequencies each."""
    out = np.zeros((len(t), joints))
    for j in range(joints):
        for f in rng.uniform(0.1, 1.3, 5):
            out[:, j] += rng.uniform(0.5, 1.0) / (1 + f) * np.sin(2 * np.pi * f * t + rng.uniform(0, 2 * np.pi))
    return 0.45 * out / np.abs(out).max(axis=0) * _ease(t)


def steps(t: Array, joints: int, rng: np.random.Generator) -> Array:
    """Each joint jumps at instants of its own."""
    out = np.zeros((len(t), joints))
    for j in range(joints):
        at = rng.uniform(0.8, 1.6)
        while at < t[-1]:
            out[t >= at, j] = rng.uniform(-0.4, 0.4)
            at += rng.uniform(0.8, 1.8)
    return out


def chirp(t: Array, joints: int, rng: np.random.Generator) -> Array:
    """From slow to fast, joints out of phase."""
    low, high = rng.uniform(0.1, 0.2), rng.uniform(1.5, 2.5)
    phase = 2 * np.pi * (low * t + (high - low) * t**2 / (2 * t[-1]))
    shrink = 0.35 / (1 + 0.5 * t / t[-1])
    return (shrink[:, None] * np.sin(phase[:, None] + 2.4 * np.arange(joints))) * _ease(t)


def sweep(t: Array, joints: int, rng: np.random.Generator) -> Array:
    """Slow triangles over a wide range: what friction and gravity show in."""
    out = np.zeros((len(t), joints))
    for j in range(joints):
        period = rng.uniform(5.0, 9.0)
        out[:, j] = 0.6 * (2 / np.pi) * np.arcsin(np.sin(2 * np.pi * t / period + rng.uniform(0, 2 * np.pi)))
    return out * _ease(t)


def working_day(t: Array, joints: int, rng: np.random.Generator) -> Array:
    """Pick and place: smooth moves between a few postures, with waits."""
    out, at, here = np.zeros((len(t), joints)), 0.7, np.zeros(joints)
    places = rng.uniform(-0.5, 0.5, (4, joints))
    while at < t[-1]:
        there, took = places[rng.integers(4)], rng.uniform(0.5, 1.2)
        s = np.clip((t - at) / took, 0.0, 1.0)
        s = s * s * s * (10 - 15 * s + 6 * s * s)
        moving = t >= at
        out[moving] = (here + s[:, None] * (there - here))[moving]
        here, at = there, at + took + rng.uniform(0.1, 0.6)
    return out
