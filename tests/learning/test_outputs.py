"""What is done with an output: the low-pass filter, and how sure the network is of it."""

from dataclasses import replace

import numpy as np
import pytest

from residual_mpc.learning.filter.kalman import Belief
from residual_mpc.learning.filter.uncertainty import output_sigma
from residual_mpc.learning.network import low_pass
from residual_mpc.learning.network.mlp import Mlp, initial_weights
from residual_mpc.learning.network.residual import Residual


def test_a_low_pass_is_the_same_whatever_the_step_and_rests_at_its_input():
    coarse, fine = low_pass.init(2), low_pass.init(2)
    delta = np.array([1.0, -3.0])
    for _ in range(10):
        _, coarse = low_pass.step(coarse, delta, 0.1, 0.5)
    for _ in range(100):
        out, fine = low_pass.step(fine, delta, 0.01, 0.5)
    np.testing.assert_allclose(coarse, fine, atol=1e-12)
    np.testing.assert_allclose(out, (1.0 - np.exp(-2.0)) * delta, atol=1e-12)
    assert np.array_equal(low_pass.step(fine, delta, 0.01, 0.0)[0], delta)
    with pytest.raises(ValueError, match="dt"):
        low_pass.step(fine, delta, 0.0, 0.5)


def test_the_uncertainty_is_that_of_drawn_weights():
    rng = np.random.default_rng(0)
    net = Mlp(2, (6,), 2)
    theta = initial_weights(net, rng) + 0.3 * rng.standard_normal(net.size)
    r = Residual(net, theta, ("a", "b"), ("c", "d"), np.zeros(2), np.array([1.0, 2.0]), np.array([1.0, 0.5]), "joint",
                 0.02)  # fmt: skip
    root = 1e-4 * rng.standard_normal((net.size, net.size))
    z = rng.standard_normal((5, 2))
    drawn = [replace(r, theta=theta + root @ rng.standard_normal(net.size))(z) for _ in range(4000)]
    np.testing.assert_allclose(output_sigma(r, Belief(theta, root @ root.T), z), np.std(drawn, axis=0), rtol=0.06)
