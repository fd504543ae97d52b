"""A value that follows another no faster than a limit lets it, in steps over which the other is held."""

import numpy as np

from residual_mpc.effects.ops import Array, Ops, clip

ENDLESS = 1e6  # SI units, for what has no limit: a smoothed minimum would make NaN of infinity, and JSON has none

TINY = 1e-30  # keeps the mean defined for a limit of 0, where it is exactly the beginning


def missing(ops: Ops, away: Array, rate: Array, dt: float) -> tuple[Array, Array]:
    """What is missing to the other value, in the mean over a step and at its end. Without a limit it is 0.

    The value moves evenly, and stands still once it has arrived: with the way m = clip(away, +-rate dt), it is missing
    away - m at the end, and away - m + m |m| / (2 rate dt) in the mean.

    Args:
        away: of the other value less this one at the beginning of the step.
        rate: 1/s of their unit; ENDLESS or more is no limit.
        dt: s.
    """
    most = rate * dt
    way = clip(ops, away, -most, most)
    end = away - way
    late = way * ops.absolute(way) / (2.0 * ops.maximum(most, TINY))
    return end + ops.where(rate < ENDLESS, late, 0.0 * late), end


def missing_at_end(mean: np.ndarray, rate: np.ndarray, dt: float) -> np.ndarray:
    """What is missing at the end of a step in which `mean` of it is missing in the mean."""
    half = 0.5 * rate * dt
    return np.asarray(mean - np.clip(mean, -half, half))
