"""The spread of a changed threshold, from the smallest costs without each unit."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from residual_mpc.comparison.sizes import Spread
from residual_mpc.comparison.thresholds import with_thresholds
from residual_mpc.comparison.units import build_units
from residual_mpc.diagnosis.fit.least_squares import Fit
from residual_mpc.models.settings import Knob

UNITS, SAMPLES = 24, 400
WIDTH, LAG = (Knob(e, t, p, changed=True) for e, t, p in (
    ("dead_zone", "left", "width"), ("actuator_lag", None, "time_constant")))  # fmt: skip
NUMBER = np.arange(UNITS)
WHERE = build_units(NUMBER, NUMBER >= UNITS // 2, NUMBER, np.zeros((UNITS, 0)))


class DeadZone:
    """Windows whose input exceeds a dead zone that is a little different in each; its edge is sharp."""

    def __init__(self, rng: np.random.Generator, own: float) -> None:
        self.u = rng.uniform(0.0, 3.0, (UNITS, SAMPLES))
        width = np.where(WHERE.later, 0.8 + own * rng.standard_normal(UNITS), 0.0)
        self.y = self.passed(width[:, None]) + 0.1 * rng.standard_normal(self.u.shape)

    def passed(self, width: Any) -> np.ndarray:
        return np.where(self.u > width, self.u, 0.0)

    def residuals(self, rows: Any) -> np.ndarray:
        return np.stack([self.passed(np.where(WHERE.later, row[WIDTH], 0.0)[:, None]) - self.y for row in rows])


def fit_of(problem: Any) -> Fit:
    grid = np.linspace(0.5, 1.2, 701)
    value = float(grid[np.argmin([np.sum(problem.residuals([{WIDTH: v}]) ** 2) for v in grid])])
    values, r = {WIDTH: value, LAG: 0.1}, problem.residuals([{WIDTH: value}])[0]
    jacobian = np.zeros((*r.shape, 2))  # of a step function
    return Fit((), (WIDTH, LAG), values, np.ones(2), float(np.sum(r**2)), r, jacobian, np.zeros(2, dtype=bool))


def test_the_spread_is_how_much_the_best_value_varies() -> None:
    rng = np.random.default_rng(0)
    found, sigmas = [], []
    for _ in range(30):
        problem: Any = DeadZone(rng, own=0.2)
        fit = fit_of(problem)
        spread = with_thresholds(problem, fit, WHERE, Spread(np.array([7.0, 3.0]), np.array([2.0, 9.0])))
        assert spread.sigma[1] == 3.0 and spread.freedom[1] == 9.0  # a lag is no threshold
        found.append(fit.values[WIDTH])
        sigmas.append(spread.sigma[0])
        assert 1.5 <= spread.freedom[0] <= UNITS
    assert np.mean(found) == pytest.approx(0.8, abs=0.1)
    assert 0.6 < np.median(sigmas) / np.std(found) < 1.7


def test_a_threshold_on_a_bound_or_on_both_sets_keeps_its_spread() -> None:
    problem: Any = DeadZone(np.random.default_rng(1), own=0.2)
    fit, before = fit_of(problem), Spread(np.array([7.0, 3.0]), np.array([2.0, 9.0]))
    held = SimpleNamespace(**{**vars(fit), "held": np.array([True, False])})
    both = SimpleNamespace(**{**vars(fit), "knobs": (WIDTH._replace(changed=False), LAG)})
    for other in (held, both):
        np.testing.assert_array_equal(with_thresholds(problem, other, WHERE, before).sigma, before.sigma)  # type: ignore[arg-type]


def test_no_threshold_is_known_better_than_the_grid() -> None:
    problem: Any = DeadZone(np.random.default_rng(2), own=0.0)
    problem.y = problem.passed(np.where(WHERE.later, 0.8, 0.0)[:, None])
    spread = with_thresholds(problem, fit_of(problem), WHERE, Spread(np.zeros(2), np.ones(2)))
    assert spread.sigma[0] == pytest.approx(0.5 * 0.8 * 0.015, rel=0.1)
