"""How fast a pose moves around each row of a log, and how well its samples tell."""

from __future__ import annotations

import numpy as np

from residual_mpc.logs.run import FloatArray, Run
from residual_mpc.logs.signals import continuous, noise_sigma, resolution

PLANE = ("pose.x", "pose.y", "pose.theta")
REACH = 0.25  # s on either side of a row over which its speed is measured
CLEAR = 0.25  # of the fastest speed: larger errors hide whether the robot moves
CERTAIN = 4.0  # standard errors


def pose_speeds(run: Run) -> list[tuple[FloatArray, FloatArray]]:
    """The speed over ground and the turning speed (n,), and below which the noise hides them, (n,), NaN where the
    samples do not tell. A part of the pose that never moves clearly says nothing, and is left out."""
    out = []
    for names in (PLANE[:2], PLANE[2:]):
        speeds, errors = zip(*(_speed(run, name) for name in names), strict=True)
        speed, error = np.linalg.norm(speeds, axis=0), CERTAIN * np.max(errors, axis=0)
        if np.isfinite(speed).any() and CLEAR * np.nanmax(speed) > np.nanmedian(error):
            out.append((speed, error))
    return out


def _speed(run: Run, name: str) -> tuple[FloatArray, FloatArray]:
    """The slope of a line through the samples around each row, (n,) 1/s, and its standard error; NaN where there are
    fewer than three."""
    y = continuous(name, run.columns[name])
    there = np.isfinite(y)
    t, value = run.t[there], y[there]
    size = max(noise_sigma(run.t, y), resolution(value))
    first, last = (np.searchsorted(t, run.t + side * REACH) for side in (-1.0, 1.0))
    count = last - first

    def total(x: FloatArray) -> FloatArray:
        sums = np.concatenate([[0.0], np.cumsum(x)])
        return np.asarray(sums[last] - sums[first])

    enough = np.where(count >= 3, count, np.nan)
    mean = total(t) / enough
    spread = total(t * t) - enough * mean**2
    slope = (total(t * value) - mean * total(value)) / spread
    return slope, size / np.sqrt(spread)
