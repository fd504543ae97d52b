"""The windows of a stream that were tested, and their gaps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from residual_mpc.monitoring.events import Moment


@dataclass(frozen=True, eq=False)
class Place:
    """Where a window of the stream lies; its relative squared errors, what of their logarithm the driving does not
    tell, and the scores of that, each (1 + C,). far: whether it was driven less alike than most of the reference."""

    segment: int
    moment: Moment
    error: np.ndarray
    rest: np.ndarray
    scores: np.ndarray
    far: bool


def gaps_of(places: Sequence[Place], series: int, rest_there: np.ndarray) -> tuple[float, float]:
    """The gap of these windows as measured, and as the reference has it for such motions.

    rest_there (W,): `rest` of the reference's windows, whose mean exponential makes a mean of squares of what is
    expected of a logarithm (smearing; Duan 1983).
    """
    error, rest = (np.array([getattr(p, of)[series] for p in places]) for of in ("error", "rest"))
    known = np.isfinite(error) & np.isfinite(rest)
    measured, usual = error[known], error[known] * np.exp(-rest[known]) * np.nanmean(np.exp(rest_there))
    return float(np.sqrt(measured.mean())), float(np.sqrt(usual.mean()))
