"""Whether probabilities mean what they say: the reliability diagram and its mean error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

EDGES = (0.0, 0.05, 0.2, 0.4, 0.6, 0.8, 0.95, 1.0 + 1e-9)


@dataclass(frozen=True)
class Bin:
    """Candidates whose stated probability fell between two edges."""

    stated: float  # mean probability
    seen: float  # share that was true
    count: int


def reliability(stated: Sequence[float], true: Sequence[bool]) -> tuple[Bin, ...]:
    """The filled bins, from improbable to sure."""
    p, y = np.asarray(stated, dtype=float), np.asarray(true, dtype=float)
    bins = []
    for low, high in zip(EDGES[:-1], EDGES[1:], strict=True):
        inside = (p >= low) & (p < high)
        if inside.any():
            bins.append(Bin(float(p[inside].mean()), float(y[inside].mean()), int(inside.sum())))
    return tuple(bins)


def calibration_error(bins: Sequence[Bin]) -> float | None:
    """Mean distance of stated from seen, weighted by count (expected calibration error); None without any."""
    total = sum(b.count for b in bins)
    return sum(b.count * abs(b.stated - b.seen) for b in bins) / total if total else None
