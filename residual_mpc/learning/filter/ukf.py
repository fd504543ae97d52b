"""The paper's unscented Kalman filter over the network's weights (its equations learning_law and UKF a to h)."""

from typing import Protocol

import numpy as np
from scipy.linalg.blas import dtrmm

from residual_mpc.learning.filter.kalman import (
    Belief,
    FilterSettings,
    Measurement,
    UpdateInfo,
    correct,
    factored,
    initial_belief,
)
from residual_mpc.learning.filter.sigma_points import SigmaWeights
from residual_mpc.learning.filter.workspace import Workspace

init = initial_belief
USUAL = FilterSettings()
NEAR = SigmaWeights()


class Sampled(Protocol):
    """What is predicted over the horizon as a function of the weights, evaluated at all sigma points at once."""

    def around(self, theta: np.ndarray, moves: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """x = x_pred(theta) (m,), and the central differences of x_pred (L + K, m) at theta + and - each row of moves
        (L, L), which is upper triangular: the first ones x+ - x- of all L rows, then the second ones x+ + x- - 2 x of
        the first K; those of the others are nothing."""
        ...


def update(
    belief: Belief,
    window: Sampled,
    measured: Measurement,
    settings: FilterSettings = USUAL,
    weights: SigmaWeights = NEAR,
    workspace: Workspace | None = None,
) -> tuple[Belief, UpdateInfo]:
    """One update over the horizon: y_t = y_{t-N} + K (x_ref - x_pred), eq. (learning_law).

    workspace: memory to compute in; nothing of it is in the answer.
    """
    workspace = Workspace() if workspace is None else workspace
    size, w = len(belief.mean), weights.covariance_weight
    belief, factor = factored(belief, settings, workspace.array(0, "factor", (size, size)))  # (UKF f)
    moves = factor.T
    if weights.reach != 1.0:
        moves = np.multiply(weights.reach, moves, out=workspace.array(0, "moves", (size, size)))
    with np.errstate(over="ignore", invalid="ignore"):
        predicted, differences = window.around(belief.mean, moves)  # (UKF e)
        # (UKF b) about the prediction of the mean weights: x+ x+' + x- x-' is half of what the differences make
        spread = 0.5 * w * (differences.T @ differences)
        if weights.curved:  # (UKF d): the deviations are then taken from the weighted mean
            total = differences[size:].sum(axis=0)
            shift = w * total
            predicted = predicted + shift
            both = w * np.outer(total, shift)
            spread += (2.0 * w * size + weights.centre) * np.outer(shift, shift) - both - both.T
        # (UKF c): the points are symmetric, so that the mean drops out; the factor is triangular
        cross = workspace.array(0, "cross", (differences.shape[1], size))
        np.copyto(cross, differences[:size].T)
        cross = dtrmm(w * weights.reach, factor, cross.T, side=0, lower=1, overwrite_b=1)
    return correct(belief, predicted, cross, spread, measured, settings)
