"""The stretches of runs that count as independent observations, as a test needs them."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Units:
    """number (W,): which of the U units each window lies in; later (U,) bool: those of the later set; run (U,): the
    run that each is a stretch of; conditions (U, k): how each was driven, on which the model's errors may depend."""

    number: np.ndarray
    later: np.ndarray
    run: np.ndarray
    conditions: np.ndarray

    @property
    def count(self) -> int:
        return len(self.later)

    def summed(self, x: np.ndarray) -> np.ndarray:
        """(U, ...) sums of x (W, ...) over the windows of each unit."""
        out = np.zeros((self.count, *x.shape[1:]))
        np.add.at(out, self.number, x)
        return out


def build_units(
    number: np.ndarray, later_windows: np.ndarray, run_windows: np.ndarray, conditions: np.ndarray
) -> Units:
    """number (W,) of each window's unit, later_windows (W,) bool, run_windows (W,) its run, conditions (W, k) of it."""
    number = np.unique(number, return_inverse=True)[1]
    later = np.zeros(int(number.max()) + 1, dtype=bool)
    run = np.zeros(len(later), dtype=int)
    later[number], run[number] = later_windows, run_windows
    return Units(number, later, run, averaged(conditions, number, len(later)))


def averaged(x: np.ndarray, at: np.ndarray, count: int) -> np.ndarray:
    """(count, k) means of x (n, k) over what `at` (n,) puts together."""
    total = np.zeros((count, x.shape[1]))
    np.add.at(total, at, x)
    return np.asarray(total / np.maximum(np.bincount(at, minlength=count), 1)[:, None])
