"""The runs, or stretches of runs, that a test treats as independent observations."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Units:
    """number (W,): the unit of each window, out of U; later (U,) bool: whether a unit belongs to the later set; run
    (U,): the run of each unit; conditions (U, k): how the robot was driven, on which the model's errors may depend."""

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
    """For each window: number (W,) of its unit, later_windows (W,) bool, run_windows (W,), conditions (W, k)."""
    number = np.unique(number, return_inverse=True)[1]
    later = np.zeros(int(number.max()) + 1, dtype=bool)
    run = np.zeros(len(later), dtype=int)
    later[number], run[number] = later_windows, run_windows
    return Units(number, later, run, averaged(conditions, number, len(later)))


def averaged(x: np.ndarray, at: np.ndarray, count: int) -> np.ndarray:
    """(count, k) means of x (n, k) over the groups numbered in `at` (n,)."""
    total = np.zeros((count, x.shape[1]))
    np.add.at(total, at, x)
    return np.asarray(total / np.maximum(np.bincount(at, minlength=count), 1)[:, None])
