"""Gaps in the time of a log: stretches without a row, so that nobody knows what was sent in them."""

from __future__ import annotations

import numpy as np

from residual_mpc.logs.run import FloatArray, Run

PERIODS = 5.0  # median periods: shorter pauses are late rows, or lost ones whose commands are interpolated
LONG = 0.25  # s: no start state can be fitted across more


def time_gaps(run: Run) -> FloatArray:
    """(k, 2) s: the stamps before and after each gap, in order."""
    rows = rows_before_gaps(run)
    return np.stack([run.t[rows], run.t[rows + 1]], axis=-1)


def rows_before_gaps(run: Run) -> np.ndarray:
    """(k,) the rows after which there is none for more than `PERIODS` periods and `LONG` s."""
    return np.flatnonzero(np.diff(run.t) > max(PERIODS * run.period, LONG))
