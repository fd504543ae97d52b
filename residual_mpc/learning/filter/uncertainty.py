"""How sure the network is of its output: the weights' covariance carried through its Jacobian."""

import numpy as np

from residual_mpc.learning.filter.kalman import Belief
from residual_mpc.learning.network.mlp import jacobian
from residual_mpc.learning.network.residual import Residual


def output_sigma(residual: Residual, belief: Belief, z: np.ndarray) -> np.ndarray:
    """(N, outputs) one standard deviation of delta at inputs z (N, inputs), in the outputs' units.

    To first order, and of the weights alone: it knows nothing of what no weights could learn.
    """
    _, slope = jacobian(residual.net, belief.mean, residual.scaled(z))  # (N, o, L)
    variance = np.einsum("noi,ij,noj->no", slope, belief.covariance, slope, optimize=True)
    return np.asarray(residual.output_scale * np.sqrt(np.maximum(variance, 0.0)))
