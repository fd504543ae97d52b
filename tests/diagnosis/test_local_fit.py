"""The quadratic through the nearest samples, against numpy.polyfit on samples picked by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from residual_mpc.diagnosis.data.local_fit import local_fit, local_fits
from residual_mpc.diagnosis.data.signals import Signal, Signals


def literal(t: np.ndarray, y: np.ndarray, at: float) -> tuple[float, float]:
    order = [i for i in np.argsort(np.abs(t - at), kind="stable")[:5] if abs(t[i] - at) <= 0.25]
    if not order:
        return np.nan, np.nan
    degree = {1: 0, 2: 1}.get(len(order), 2)
    p = np.polyfit(t[order] - at, y[order], degree)
    return float(p[-1]), (float(p[-2]) if degree else np.nan)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10_000), n=st.integers(1, 40), rate=st.sampled_from([3.0, 8.0, 20.0, 200.0]))
def test_irregular_samples(seed: int, n: int, rate: float) -> None:
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.uniform(0.2, 1.8, n)) / rate
    y = rng.standard_normal(n)
    query = rng.uniform(t[0] - 0.3, t[-1] + 0.3, 12)
    fit = local_fit(t, query)
    wanted = np.array([literal(t, y, q) for q in query])
    scale = 1.0 + np.abs(np.nan_to_num(wanted))
    np.testing.assert_allclose(fit.value(y) / scale[:, 0], wanted[:, 0] / scale[:, 0], atol=1e-7)
    np.testing.assert_allclose(fit.slope(y) / scale[:, 1], wanted[:, 1] / scale[:, 1], atol=1e-7)


@pytest.mark.parametrize(("count", "degree"), [(5, 2), (4, 2), (3, 2), (2, 1), (1, 0)])
def test_how_far_a_polynomial_is_followed(count: int, degree: int) -> None:
    t = 0.02 * np.arange(count)
    y = 3.0 - 2.0 * t + 5.0 * t**2
    fit, at = local_fit(t, np.array([0.01])), 0.01
    assert fit.count[0] == count
    wanted = np.polyval(np.polyfit(t, y, degree), at)
    assert fit.value(y)[0] == pytest.approx(wanted, abs=1e-12)
    if degree == 2:
        assert fit.slope(y)[0] == pytest.approx(-2.0 + 10.0 * at, abs=1e-9)


def test_nothing_within_reach() -> None:
    t = np.array([0.0, 1.0])
    fit = local_fit(t, np.array([0.5, 0.25, 0.7501]))
    assert fit.count.tolist() == [0, 1, 1]
    assert np.isnan(fit.value(t)[0]) and np.isnan(fit.slope(t)).all()  # one sample has no slope
    np.testing.assert_allclose(fit.value(t)[1:], [0.0, 1.0])


def test_no_sample_at_all() -> None:
    fit = local_fit(np.empty(0), np.array([0.0, 1.0]))
    assert np.isnan(fit.value(np.empty(0))).all() and fit.count.tolist() == [0, 0]


def test_weights_are_linear_and_sum_to_one() -> None:
    rng = np.random.default_rng(0)
    t = np.sort(rng.uniform(0, 1, 30))
    fit = local_fit(t, rng.uniform(0, 1, 10))
    np.testing.assert_allclose(fit.value_weights.sum(axis=1), 1.0, atol=1e-9)
    np.testing.assert_allclose(fit.slope_weights.sum(axis=1), 0.0, atol=1e-6)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10_000), absent=st.booleans())
def test_all_runs_at_once_are_fitted_like_each_alone(seed: int, absent: bool) -> None:
    """Runs whose clocks overlap, start anywhere and need not have the channel."""
    rng = np.random.default_rng(seed)
    signals = {}
    for i in range(4):
        if absent and i in (1, 3):
            continue
        t = rng.uniform(-50.0, 50.0) + np.cumsum(rng.uniform(0.2, 1.8, rng.integers(1, 30))) / 20.0
        signals[i, "pose.x"] = Signal(t, rng.standard_normal(len(t)))
    run = rng.integers(0, 4, 40)
    query = np.array([rng.choice(signals[i, "pose.x"].t) if (i, "pose.x") in signals else 0.0 for i in run])
    query += rng.uniform(-0.3, 0.3, 40)
    joined = Signals(signals).joined("pose.x")
    assert joined is not None
    fit = local_fits(joined, run, query)
    for i in range(4):
        t, y = (signals[i, "pose.x"].t, signals[i, "pose.x"].y) if (i, "pose.x") in signals else (np.empty(0),) * 2
        alone = local_fit(t, query[run == i])
        for of in ("value", "slope", "curvature"):
            np.testing.assert_allclose(
                getattr(fit, of)(joined.y)[run == i], getattr(alone, of)(y), rtol=1e-9, atol=1e-9
            )
