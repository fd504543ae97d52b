"""The low-pass filter of a network's output."""

import numpy as np
import pytest

from residual_mpc.learning.network import low_pass


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
