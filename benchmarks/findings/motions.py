"""Motions that a robot is sent on: wheel speeds of a differential drive, setpoints of an arm's joints."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Rng = np.random.Generator


def multisine(rng: Rng, t: Array) -> Array:
    """Four sines of 0.05 to 0.6 Hz, within -1 to 1."""
    frequency, phase = rng.uniform(0.05, 0.6, 4), rng.uniform(0, 2 * np.pi, 4)
    return np.asarray(np.sin(2 * np.pi * np.outer(t, frequency) + phase).sum(axis=1) / 3.2)


def held(rng: Rng, t: Array, shortest: float, longest: float, low: float = -1.0) -> Array:
    """Random levels between `low` and 1, each held for some seconds."""
    ends = np.cumsum(rng.uniform(shortest, longest, int(t[-1] / shortest) + 2))
    return np.asarray(rng.uniform(low, 1, len(ends))[np.searchsorted(ends, t, side="right")])


def smooth(rng: Rng, t: Array) -> Array:
    """A random curve with a bend about each two seconds."""
    from scipy.interpolate import CubicSpline

    knots = np.arange(0, t[-1] + 4, 2.0)
    return np.clip(CubicSpline(knots, rng.uniform(-0.9, 0.9, len(knots)))(t), -1, 1)


def spin(rng: Rng, t: Array) -> Array:
    """Turns to both sides with short rests."""
    level = held(rng, t, 1.0, 3.0)
    return np.where(np.abs(level) < 0.2, 0.0, level)


Pair = Callable[[Rng, Array], tuple[Array, Array]]
DRIVES: dict[str, Pair] = {  # forward and turning, each within -1 to 1
    "multisine": lambda rng, t: (multisine(rng, t), multisine(rng, t)),
    "steps": lambda rng, t: (held(rng, t, 1, 3), held(rng, t, 1, 3)),
    "spins": lambda rng, t: (np.zeros_like(t), spin(rng, t)),
    "arcs": lambda rng, t: (held(rng, t, 4, 8, 0.2), held(rng, t, 4, 8)),
    "smooth": lambda rng, t: (smooth(rng, t), smooth(rng, t)),
    "straight": lambda rng, t: (held(rng, t, 2, 5), 0.1 * smooth(rng, t)),
}


def drive(rng: Rng, kind: str, seconds: float, rate: float, top: float, rests: bool = False) -> Array:
    """Wheel speeds (ticks, 2) in rad/s under `top` at `rate` Hz; with `rests` the robot stands still now and then."""
    t = np.arange(round(seconds * rate)) / rate
    forward, turn = DRIVES[kind](rng, t)
    share = rng.uniform(0.5, 0.7)
    wheels = top * np.stack([share * forward - (1 - share) * turn, share * forward + (1 - share) * turn], axis=1)
    if rests:
        for begin in (0.0, *rng.uniform(0.2, 0.9, 2) * seconds):
            wheels[(t >= begin) & (t < begin + rng.uniform(1.5, 4.0))] = 0.0
    return np.asarray(wheels)


def setpoints(rng: Rng, seconds: float, rate: float, centre: Sequence[float], reach: Sequence[float]) -> Array:
    """Setpoints (ticks, joints) about `centre`: each joint moves by sines, steps or a smooth curve within `reach`."""
    t = np.arange(round(seconds * rate)) / rate
    kinds = [multisine, smooth, lambda g, s: held(g, s, 1.5, 4.0)]
    rise = np.minimum(t / 1.0, 1.0)  # every run begins at its centre
    columns = [c + r * rise * kinds[rng.integers(3)](rng, t) for c, r in zip(centre, reach, strict=True)]
    return np.stack(columns, axis=1)
