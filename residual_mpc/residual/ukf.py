"""The paper's unscented Kalman filter over the network's weights (its equations learning_law and UKF a to h)."""

from typing import Protocol

import numpy as np

from residual_mpc.residual.filter import (
    Belief,
    FilterSettings,
    Info,
    Measurement,
    correct,
    lower_factor,
    predicted_covariance,
    start,
)
from residual_mpc.residual.room import Room
from residual_mpc.residual.sigma import SigmaWeights

init = start
USUAL = FilterSettings()
NEAR = SigmaWeights()


class Sampled(Protocol):
    """What is predicted over the horizon as a function of the weights, evaluated at all sigma points at once."""

    def around(self, theta: np.ndarray, moves: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """x_pred(theta) (m,), and x_pred(theta +- moves[j]) - x_pred(theta), (2, L, m); moves (L, L) is upper
        triangular."""
        ...


def update(
    belief: Belief,
    window: Sampled,
    measured: Measurement,
    settings: FilterSettings = USUAL,
    weights: SigmaWeights = NEAR,
    room: Room | None = None,
) -> tuple[Belief, Info]:
    """One update over the horizon: y_t = y_{t-N} + K (x_ref - x_pred), eq. (learning_law).

    room: memory to compute in; nothing of it is in the answer.
    """
    from scipy.linalg.blas import dtrmm

    room = Room() if room is None else room
    size, w = len(belief.mean), weights.covariance_weight
    p = predicted_covariance(belief, settings, room.array(0, "covariance", (size, size)))
    p, factor = lower_factor(p, room.array(0, "factor", (size, size)))
    moves = factor.T
    if weights.reach != 1.0:
        moves = np.multiply(weights.reach, moves, out=room.array(0, "moves", (size, size)))
    with np.errstate(over="ignore", invalid="ignore"):
        centre, change = window.around(belief.mean, moves)  # (UKF e); row j: point j less the mean
        flat = change.reshape(2 * size, -1)
        spread = w * (flat.T @ flat)  # (UKF b), about the prediction of the mean weights
        predicted = centre
        if weights.curved:  # (UKF d): the deviations are then taken from the weighted mean
            total = flat.sum(axis=0)
            shift = w * total
            predicted = centre + shift
            both = w * np.outer(total, shift)
            spread += (2.0 * w * size + weights.centre) * np.outer(shift, shift) - both - both.T
        delta = np.subtract(change[0], change[1], out=room.array(0, "delta", change.shape[1:]))
        # (UKF c): the points are symmetric, so the mean drops out; the factor is triangular
        cross = dtrmm(w * weights.reach, factor, delta.T, side=1, lower=1, trans_a=1, overwrite_b=1).T
    after, info = correct(belief.mean, p, predicted, cross, spread, measured, settings)
    return (Belief(after.mean, p.copy()) if after.covariance is p else after), info
