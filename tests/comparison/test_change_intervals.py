"""The jackknife's standard deviations against refits without each unit in turn."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from diagnosis.linear import GAIN, HEADING, SCALE, Linear, fitted, space_of, windows

from residual_mpc.comparison.sets import units_of
from residual_mpc.comparison.settings import ComparisonSettings, ContrastSettings
from residual_mpc.comparison.sizes import _there_before, came_to_nothing, changed_numbers, jackknife, least_half
from residual_mpc.comparison.space import ChangeSpace, change_space
from residual_mpc.comparison.units import Units, build_units
from residual_mpc.models.settings import Knob

RUNS, SAMPLES = 6, 20
DATA = windows(RUNS, 12.0)
SPACE: ChangeSpace = change_space(space_of(DATA))
LATER = np.arange(RUNS) >= RUNS // 2
NUMBER = units_of(DATA, LATER, ContrastSettings())
UNITS: Units = build_units(NUMBER, LATER[DATA.run], DATA.run, np.zeros((DATA.count, 0)))
CHANGED = SCALE._replace(changed=True)
TRUTH = {SCALE: 1.2, GAIN: 0.9, CHANGED: 1.1}


def linear(rng: np.random.Generator, own: float = 0.1) -> Any:
    """A change that moves later windows alone; every unit has a scale of its own."""
    columns = dict(zip((SCALE, GAIN), 3.0 * rng.standard_normal((2, DATA.count, SAMPLES)), strict=True))
    columns[CHANGED] = 1.2 * columns[SCALE] * UNITS.later[UNITS.number][:, None]
    noise = rng.standard_normal((DATA.count, SAMPLES))
    noise += own * rng.standard_normal(UNITS.count)[UNITS.number, None] * columns[SCALE]
    return Linear(DATA, SPACE, columns, TRUTH, noise)


def refit(problem: Any, knobs: Any, keep: np.ndarray) -> np.ndarray:
    """The least-squares values on the windows `keep` (W,) alone, from the normal equations."""
    j = np.stack([problem.columns[k][keep].ravel() for k in knobs], axis=1)
    offset = problem.noise[keep].ravel() - j @ np.array([problem.truth[k] for k in knobs])
    return np.asarray(np.linalg.solve(j.T @ j, -j.T @ offset))


def literal(problem: Any, knobs: Any) -> np.ndarray:
    """Standard deviations: for each set (n - 1) / n times the sum of squares of what leaving one unit out does."""
    everything = refit(problem, knobs, np.ones(DATA.count, dtype=bool))
    variance = np.zeros(len(knobs))
    for side in (True, False):
        mine = np.flatnonzero(UNITS.later == side)
        for unit in mine:
            moved = refit(problem, knobs, UNITS.number != unit) - everything
            variance += (len(mine) - 1) / len(mine) * moved**2
    return np.sqrt(variance)


def test_the_jackknife_is_the_one_that_refits() -> None:
    problem = linear(np.random.default_rng(0))
    fit = fitted(problem, {SCALE: 1.0, GAIN: 1.0, CHANGED: 1.0})
    assert not fit.held.any()
    spread = jackknife(fit, UNITS)
    np.testing.assert_allclose(spread.sigma, literal(problem, fit.knobs), rtol=1e-3)
    assert (spread.freedom >= 1.5).all() and (spread.freedom <= UNITS.count).all()


def test_an_interval_covers_the_change_as_often_as_it_says() -> None:
    """Where stretches differ by more than the noise, which least squares alone would take for certainty."""
    rng = np.random.default_rng(1)
    inside, halves, values = [], [], []
    for _ in range(60):
        problem = linear(rng)
        fit = fitted(problem, {SCALE: 1.0, GAIN: 1.0, CHANGED: 1.0})
        (number,) = changed_numbers(problem, fit, CHANGED.term, jackknife(fit, UNITS), 0.0)
        low, high = number.ci95
        inside.append(low <= 1.1 <= high)
        halves.append(0.5 * (high - low))
        values.append(number.change)
    assert np.mean(inside) > 0.85
    assert 0.6 < np.mean(halves) / (1.96 * np.std(values, ddof=1)) < 1.7


def test_a_change_states_what_was_what_is_and_the_ratio() -> None:
    problem = linear(np.random.default_rng(2), own=0.0)
    fit = fitted(problem, {SCALE: 1.0, GAIN: 1.0, CHANGED: 1.0})
    (number,) = changed_numbers(problem, fit, CHANGED.term, jackknife(fit, UNITS), 0.0)
    assert number.name == "scale" and number.unit == "1" and number.note == ""
    assert number.before == pytest.approx(1.2, abs=0.05)
    assert number.after == pytest.approx(number.before * number.change)
    assert number.change == pytest.approx(fit.values[CHANGED])
    assert changed_numbers(problem, fit, HEADING._replace(changed=True).term, jackknife(fit, UNITS), 0.0) == ()


def test_no_change_is_known_better_than_its_law() -> None:
    problem = linear(np.random.default_rng(3))
    fit = fitted(problem, {SCALE: 1.0, GAIN: 1.0, CHANGED: 1.0})
    spread = jackknife(fit, UNITS)
    (plain,), (number,) = (changed_numbers(problem, fit, CHANGED.term, spread, law) for law in (0.0, 0.5))
    half, law = (0.5 * (n.ci95[1] - n.ci95[0]) for n in (plain, number))
    assert law == pytest.approx(np.hypot(half, 0.5 * abs(plain.change - 1.0)))


def test_a_change_that_may_be_none_says_so() -> None:
    """Also where it is a ratio, which is 1 and not 0 where nothing changed."""
    problem = linear(np.random.default_rng(4), own=0.0)
    fit = fitted(problem, {SCALE: 1.0, GAIN: 1.0, CHANGED: 1.0})
    spread = jackknife(fit, UNITS)
    (clear,) = changed_numbers(problem, fit, CHANGED.term, spread, 0.0)
    assert clear.ci95[0] > 1.0
    (vague,) = changed_numbers(problem, fit, CHANGED.term, spread, 2.0)
    assert clear.none == 1.0 and not clear.may_be_none
    assert vague.ci95[0] < 1.0 < vague.ci95[1] and vague.may_be_none


def test_a_change_that_the_last_fit_left_without_a_size_came_to_nothing() -> None:
    problem = linear(np.random.default_rng(5), own=0.0)
    fit = fitted(problem, {SCALE: 1.0, GAIN: 1.0, CHANGED: 1.0})
    assert not came_to_nothing(fit, SPACE, CHANGED.term)
    assert came_to_nothing(replace(fit, values={**fit.values, CHANGED: 1.0}), SPACE, CHANGED.term)
    assert not came_to_nothing(fit, SPACE, HEADING._replace(changed=True).term)  # not in the fit


@pytest.mark.parametrize("errors", [0.0, 3.0])
def test_an_interval_allows_for_errors_that_all_stretches_share(errors: float) -> None:
    """Errors of the model that no effect describes, `errors` times the noise: no fit without a stretch shows them."""
    rng = np.random.default_rng(4)
    problem = linear(rng, own=0.0)
    problem.noise = problem.noise + errors * rng.standard_normal(problem.noise.shape)
    fit = fitted(problem, {SCALE: 1.0, GAIN: 1.0, CHANGED: 1.0})
    sensors = SimpleNamespace(sigma=np.ones(1), y=np.zeros((*problem.noise.shape, 1)))
    of = SimpleNamespace(data=sensors, weight=np.ones(1), space=SPACE)
    settings = ComparisonSettings()
    beyond = errors**2 * problem.noise.size / np.sum((0.1 * problem.columns[CHANGED]) ** 2)
    expected = np.hypot(settings.results.causes.law, settings.hidden * np.sqrt(beyond))
    assert least_half(of, fit, CHANGED.term, settings) == pytest.approx(expected, rel=0.35, abs=0.02)  # type: ignore[arg-type]


def test_an_effect_that_is_gone_is_at_no_bound_and_as_uncertain_as_it_was() -> None:
    rng, lag = np.random.default_rng(5), Knob("actuator_lag", None, "time_constant")
    change = lag._replace(changed=True)
    column = 30.0 * rng.standard_normal((DATA.count, SAMPLES))
    columns = {lag: column, change: column * UNITS.later[UNITS.number][:, None]}
    problem: Any = Linear(DATA, SPACE, columns, {lag: 0.1, change: -0.13}, rng.standard_normal(column.shape))
    fit = fitted(problem, {lag: 0.08, change: -0.02})
    (number,) = changed_numbers(problem, fit, change.term, jackknife(fit, UNITS), 0.0)
    assert number.after == 0.0 and number.note == ""
    half = 0.5 * (number.ci95[1] - number.ci95[0])
    (before,) = (fit.knobs.index(k) for k in fit.knobs if k == lag)
    assert half == pytest.approx(2.0 * jackknife(fit, UNITS).sigma[before], rel=0.3)


def test_how_an_effect_acts_has_no_value_before_where_the_effect_was_not_there() -> None:
    ratio = Knob("joint_compliance", "j2", "damping_ratio", changed=True)
    spring = Knob("joint_compliance", "j2", "stiffness")
    assert not _there_before({ratio: 0.05, spring._replace(changed=True): 200.0}, ratio)
    assert not _there_before({ratio: 0.05, spring: float("inf")}, ratio)
    assert not _there_before({ratio: 0.05, spring._replace(target="j1"): 300.0}, ratio)
    assert _there_before({ratio: 0.05, spring: 300.0}, ratio)
    assert _there_before({ratio: 0.05, spring._replace(target=None): 300.0}, ratio)
