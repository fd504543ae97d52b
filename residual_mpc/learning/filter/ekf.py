"""The extended Kalman filter behind the UKF's interface: the exact Jacobian in place of sigma points.

It costs one Jacobian where the UKF costs 2 L + 1 networks, so that it is the choice for a larger network.
"""

from typing import Protocol

import numpy as np

from residual_mpc.learning.filter.kalman import (
    Belief,
    FilterSettings,
    Measurement,
    UpdateInfo,
    correct,
    initial_belief,
    predicted_covariance,
)

init = initial_belief
USUAL = FilterSettings()


class Differentiable(Protocol):
    """What is predicted over the horizon as a function of the weights, with its derivative."""

    def linear(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """x_pred(theta) (m,) and its Jacobian (m, L)."""
        ...


def update(
    belief: Belief, window: Differentiable, measured: Measurement, settings: FilterSettings = USUAL
) -> tuple[Belief, UpdateInfo]:
    """One update over the horizon, as `residual_mpc.learning.filter.ukf.update`."""
    p = predicted_covariance(belief, settings)
    with np.errstate(over="ignore", invalid="ignore"):
        predicted, h = window.linear(belief.mean)
        cross = (h @ p).T  # stored by columns
        spread = h @ cross
    return correct(belief, predicted, cross, 0.5 * (spread + spread.T), measured, settings)
