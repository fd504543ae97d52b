"""A Kalman update that may not make what it was computed from worse.

A large innovation asks for weights at which the linear picture of the prediction is long wrong. The update is then
halved, as a line search halves the step of a Gauss-Newton method, until it is accepted.
"""

from collections.abc import Callable

import numpy as np

from residual_mpc.learning.filter.kalman import Belief, FilterSettings, predicted_belief, predicted_covariance


def guarded_update(
    before: Belief, after: Belief, accepts: Callable[[np.ndarray], bool], halvings: int, settings: FilterSettings
) -> tuple[Belief, float]:
    """(belief, share of the step that was taken): the longest of the steps 1, 1/2, ... 2^-halvings that is accepted.

    accepts: whether weights (L,) are no worse than those of `before`, asked from the longest step to the shortest. A
    shortened step has not used up what the measurement says, so that it keeps the predicted covariance P + C_theta;
    where no step is accepted, the weights stay where they were and the share is 0.
    """
    share = 1.0
    for _ in range(halvings + 1):
        mean = before.mean + share * (after.mean - before.mean)
        if accepts(mean):
            return after if share == 1.0 else Belief(mean, predicted_covariance(before, settings)), share
        share *= 0.5
    return predicted_belief(before, settings), 0.0
