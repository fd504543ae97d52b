"""Predictions between the nodes of a replay are straight lines, whether the hypotheses share their times or not."""

from __future__ import annotations

import numpy as np
import pytest

from residual_mpc.diagnosis.predict.replay import _interpolate, _since

DT, NODES = 0.1, 11


@pytest.mark.parametrize("late", [[0.0, 0.0, 0.0], [0.0, 0.03, 0.21]])
def test_it_is_numpys_interpolation_inside(late: list[float]) -> None:
    rng = np.random.default_rng(0)
    nodes, t = rng.normal(size=(3, 2, NODES)), rng.uniform(0.25, 0.95, size=(2, 7))
    t[1, -2:] = np.nan
    since = _since(t, np.array(late)[:, None, None])
    assert len(since) == (1 if late == [0.0] * 3 else 3)
    found = _interpolate(nodes, since, DT)
    for h in range(3):
        for w in range(2):
            expected = np.interp(t[w] - late[h], DT * np.arange(NODES), nodes[h, w])
            np.testing.assert_allclose(found[h, w], np.where(np.isnan(t[w]), np.nan, expected), rtol=1e-12)


def test_it_goes_straight_on_beyond_both_ends() -> None:
    nodes = 2.0 * DT * np.arange(NODES)[None, None]
    np.testing.assert_allclose(_interpolate(nodes, np.array([[[-0.05, 1.2]]]), DT)[0, 0], [-0.1, 2.4])
