"""Sensor noise as white noise plus first-order coloured parts, and draws of it.

Localisation noise wanders: a pose from scan matching or a filter is wrong by about the same amount for tenths of
seconds. White noise of the same size averages out of a window's start and of its prediction, coloured noise does not.
"""

from dataclasses import dataclass

import numpy as np

from residual_mpc.effects.recursion import first_order


@dataclass(frozen=True)
class ChannelNoise:
    """white: 1-sigma of the white part, channel unit; coloured: (1-sigma in the channel's unit, correlation time in s)
    of each Ornstein-Uhlenbeck part."""

    white: float
    coloured: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        if self.white < 0.0 or any(sigma < 0.0 or time <= 0.0 for sigma, time in self.coloured):
            raise ValueError(f"sizes must be >= 0 and correlation times > 0, got {self}")

    @property
    def sigma(self) -> float:
        """1-sigma of all parts together, channel unit."""
        return float(np.sqrt(self.white**2 + sum(s * s for s, _ in self.coloured)))

    def scaled_to(self, sigma: float) -> "ChannelNoise":
        """The same colour at another total 1-sigma."""
        factor = sigma / self.sigma if self.sigma > 0.0 else 0.0
        return ChannelNoise(self.white * factor, tuple((s * factor, time) for s, time in self.coloured))


def draw_coloured(noise: ChannelNoise, t: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(n,) channel unit: the coloured parts at stamps t (n,) s."""
    out = np.zeros(len(t))
    for sigma, time in noise.coloured:
        out += sigma * ornstein_uhlenbeck(t, time, 1, rng)[0]
    return out


def ornstein_uhlenbeck(t: np.ndarray, time: float, rows: int, rng: np.random.Generator) -> np.ndarray:
    """(rows, n) stationary, unit variance, exp(-dt / time) from one stamp of t (n,) s to the next: exact for stamps
    that are evenly spaced, and by the median spacing otherwise (Gillespie 1996, eq. 3.1)."""
    x = rng.standard_normal((rows, len(t)))
    if len(t) < 2:
        return np.asarray(x)
    rho = float(np.exp(-np.median(np.diff(t)) / time))
    x[:, 1:] *= np.sqrt(1.0 - rho * rho)
    return first_order(rho, x, np.zeros(rows))
