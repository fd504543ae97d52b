"""A number is computed once for the same samples, and anew for any others."""

import numpy as np
import pytest

from residual_mpc.logs import by_content as module
from residual_mpc.logs.by_content import by_content


def counted():
    asked = []

    def total(*arrays):
        asked.append(arrays)
        return float(sum(a.sum() for a in arrays))

    return by_content(total), asked


def test_the_same_content_is_computed_once():
    total, asked = counted()
    x = np.arange(6.0)
    assert total(x) == total(x.copy()) == total(np.stack([x, x], axis=1)[:, 0]) == 15.0
    assert len(asked) == 1


@pytest.mark.parametrize(
    "other",
    [
        (np.array([0.0, 1.0, 2.5]),),
        (np.array([0, 1, 2]),),
        (np.array([[0.0, 1.0, 2.0]]),),
        (np.array([0.0, 1.0]), np.array([2.0])),
        (np.array([-0.0, 1.0, 2.0]),),
    ],
)
def test_other_content_shape_or_division_is_computed_anew(other):
    total, asked = counted()
    total(np.array([0.0, 1.0, 2.0]))
    total(*other)
    assert len(asked) == 2


def test_a_change_in_place_is_seen():
    total, _ = counted()
    x = np.arange(3.0)
    assert total(x) == 3.0
    x[0] = 4.0
    assert total(x) == 7.0


def test_nan_is_kept_and_the_store_is_bounded(monkeypatch):
    monkeypatch.setattr(module, "MOST", 3)
    total, asked = counted()
    assert np.isnan(total(np.array([np.nan]))) and np.isnan(total(np.array([np.nan])))
    assert len(asked) == 1
    for k in range(5):
        total(np.array([float(k)]))
    assert np.isnan(total(np.array([np.nan]))) and len(asked) == 7
