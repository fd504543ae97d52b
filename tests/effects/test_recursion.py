"""The first-order recursion against scipy.signal, and at its edges."""

import numpy as np
import pytest
from scipy.signal import lfilter

from residual_mpc.effects.recursion import first_order


@pytest.mark.parametrize("shape", [(1, 2), (5, 40), (2, 3, 126)])
def test_it_is_the_filter(shape: tuple[int, ...]) -> None:
    rng = np.random.default_rng(1)
    x, before = rng.standard_normal(shape), rng.standard_normal(shape[:-1])
    kept = x.copy()
    y, _ = lfilter([1.0], [1.0, -0.93], x, axis=-1, zi=0.93 * before[..., None])
    np.testing.assert_allclose(first_order(0.93, x, before), y, rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(x, kept)  # the input stays


def test_one_sample_and_none() -> None:
    np.testing.assert_allclose(first_order(0.5, np.array([[1.0]]), np.array([4.0])), [[3.0]])
    assert first_order(0.5, np.zeros((3, 0)), np.zeros(3)).shape == (3, 0)
    assert first_order(0.5, np.zeros((0, 7)), np.zeros(0)).shape == (0, 7)


def test_sequences_in_any_memory_order() -> None:
    x = np.random.default_rng(2).standard_normal((30, 4)).T  # strided
    np.testing.assert_allclose(first_order(0.2, x, np.zeros(4)), lfilter([1.0], [1.0, -0.2], x, axis=1))
