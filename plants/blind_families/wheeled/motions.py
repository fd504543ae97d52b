"""What a wheeled robot is told to do: forward speed and yaw rate over time, (n,) each, m/s and rad/s."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Motion = Callable[[Array, float, float, np.random.Generator], tuple[Array, Array]]
REST = 0.5  # s of standing still at the start of every run


def _multisine(t: Array, amplitude: float, rng: np.random.Generator, low: float, high: float) -> Array:
    f = rng.uniform(low, high, 5)
    a = rng.uniform(0.5, 1.0, 5)
    wave = (a[:, None] * np.sin(2 * np.pi * f[:, None] * t + rng.uniform(0, 2 * np.pi, 5)[:, None])).sum(axis=0)
    return amplitude * wave / np.max(np.abs(wave))


def _holds(t: Array, values: Callable[[], float], rng: np.random.Generator, low: float, high: float) -> Array:
    out, at = np.zeros_like(t), 0.0
    while at < t[-1]:
        until = at + rng.uniform(low, high)
        out[(t >= at) & (t < until)] = values()
        at = until
    return out


def rich(t: Array, v: float, w: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """Both signs of the speed, times a multisine of the yaw rate."""
    sign = np.sign(np.sin(2 * np.pi * t / rng.uniform(6, 9)) + 1e-9)
    return v * sign * (0.75 + 0.25 * np.sin(2 * np.pi * t / rng.uniform(2.5, 4))), _multisine(t, w, rng, 0.1, 0.7)


def waves(t: Array, v: float, w: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """Two independent multisines."""
    return _multisine(t, v, rng, 0.08, 0.6), _multisine(t, w, rng, 0.08, 0.6)


def steps(t: Array, v: float, w: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """Held speeds and yaw rates that jump."""
    return (
        _holds(t, lambda: float(rng.uniform(-v, v)), rng, 0.6, 1.6),
        _holds(t, lambda: float(rng.uniform(-w, w)), rng, 0.6, 1.6),
    )


def spin(t: Array, v: float, w: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """Turns on the spot, both ways."""
    return np.zeros_like(t), _holds(t, lambda: float(rng.uniform(-1.3, 1.3) * w), rng, 0.8, 2.0)


def shuttle(t: Array, v: float, w: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """Straight ahead and back at two headings, at several speeds."""
    leg = t[-1] / 2
    speed = _holds(t, lambda: float(rng.choice([-1, 1]) * rng.uniform(0.4, 1.0) * v), rng, 1.0, 2.0)
    turning = np.abs(t - leg) < 0.9
    return np.where(turning, 0.0, speed), np.where(turning, w * 0.9, 0.0)


def figure_eight(t: Array, v: float, w: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """Smooth eights at an almost constant speed."""
    period = rng.uniform(6, 10)
    return np.full_like(t, 0.7 * v), 0.8 * w * np.sin(2 * np.pi * t / period)


def reversals(t: Array, v: float, w: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """Frequent changes of sign, through small commands: what play and dead zones show in."""
    return (
        v * 0.6 * np.sin(2 * np.pi * t / rng.uniform(2.0, 3.0)),
        w * 0.5 * np.sin(2 * np.pi * t / rng.uniform(2.2, 3.6) + 1.0),
    )


def straight(t: Array, v: float, w: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """One heading, one speed: where most contact effects are one."""
    return np.full_like(t, float(rng.uniform(0.5, 0.9)) * v), np.zeros_like(t)


def limited(wave: Array, t: Array, rate: float) -> Array:
    """``wave`` with its slope held under ``rate`` (per second), at rest for the first ``REST`` seconds."""
    out = np.zeros_like(wave)
    for k in range(1, len(t)):
        goal = wave[k] if t[k] >= REST else 0.0
        most = rate * (t[k] - t[k - 1])
        out[k] = out[k - 1] + min(max(goal - out[k - 1], -most), most)
    return out
