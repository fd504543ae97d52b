"""Thinning keeps what is rare: windows stand for as many as they were drawn from."""

import numpy as np
import pytest

from residual_mpc.diagnosis.screen import drawn


def test_the_windows_drawn_stand_for_all() -> None:
    cost = np.random.default_rng(0).gamma(2.0, size=400)
    counts = drawn(cost, 60)
    assert 30 <= np.count_nonzero(counts) <= 60
    assert counts.sum() == pytest.approx(400, rel=0.1)
    assert counts @ cost == pytest.approx(cost.sum(), rel=0.1)


def test_a_window_that_holds_nearly_everything_is_always_drawn() -> None:
    for place in range(50):
        cost = np.ones(50)
        cost[place] = 1e4
        counts = drawn(cost, 12)
        assert counts[place] > 0.0
        assert counts @ cost == pytest.approx(cost.sum(), rel=0.2)


def test_nothing_left_to_explain_is_drawn_evenly() -> None:
    counts = drawn(np.zeros(40), 10)
    assert np.count_nonzero(counts) == 10
    np.testing.assert_allclose(counts[counts > 0], 4.0)
