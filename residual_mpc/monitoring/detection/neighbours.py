"""How unusual a window's error is among the reference's windows that were driven alike."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from residual_mpc.monitoring.settings import DetectionSettings

LEAST = 1e-9


@dataclass(frozen=True, eq=False)
class Usual:
    """The logarithm of each series' error as it depends on the driving, by ridge regression: a model that misses a
    share of the motion misses more of a larger one. slope (1 + D, S) on 1 and D numbers."""

    slope: np.ndarray

    def without(self, error: np.ndarray, numbers: np.ndarray) -> np.ndarray:
        """(W, S) what of the logarithm of the errors the driving does not tell."""
        return np.asarray(_logarithm(error) - np.column_stack([np.ones(len(numbers)), numbers]) @ self.slope)


def usual_errors(error: np.ndarray, numbers: np.ndarray, settings: DetectionSettings) -> Usual:
    """Of errors (W, S) and numbers (W, D)."""
    x = np.column_stack([np.ones(len(numbers)), numbers])
    penalty = np.diag([0.0] + [settings.ridge] * numbers.shape[1])
    return Usual(np.linalg.solve(x.T @ x + penalty, x.T @ _logarithm(error)))


def _logarithm(error: np.ndarray) -> np.ndarray:
    return np.asarray(np.log(error + LEAST))


@dataclass(frozen=True, eq=False)
class Driving:
    """The space in which windows are neighbours: principal components of the reference's driving. centre, spread (F,);
    axes (F, K)."""

    centre: np.ndarray
    spread: np.ndarray
    axes: np.ndarray

    def of(self, driving: np.ndarray) -> np.ndarray:
        """(W, F) -> (W, K)"""
        return np.asarray(((driving - self.centre) / self.spread) @ self.axes)


def driving_space(driving: np.ndarray, settings: DetectionSettings) -> Driving:
    """Of (W, F), in units of each number's spread."""
    centre, spread = driving.mean(axis=0), driving.std(axis=0)
    spread = np.where(spread > LEAST * (1.0 + np.abs(centre)), spread, np.inf)
    _, size, axes = np.linalg.svd((driving - centre) / spread, full_matrices=False)
    there = int(np.clip((size > 1e-6 * size.max(initial=LEAST)).sum(), 1, settings.components))
    return Driving(centre, spread, axes[:there].T)


def neighbour_count(windows: int, settings: DetectionSettings) -> int:
    most = max(settings.fewest_neighbours, round(settings.neighbours * windows))
    return min(most, settings.most_neighbours, windows)


def ranked(rest: np.ndarray, around: np.ndarray) -> np.ndarray:
    """(W, S) normal scores of the ranks of rest (W, S) among neighbours (W, k, S), NaN where there are none."""
    below = (around < rest[:, None]).sum(axis=1)
    equal = (around == rest[:, None]).sum(axis=1)
    return np.asarray(ndtri((below + 0.5 * equal + 0.5) / (np.isfinite(around).sum(axis=1) + 1.0)))
