"""The test by permutation, on estimates drawn directly: level, power, outlying stretches, conditions, few runs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import ttest_ind

from residual_mpc.comparison.permutation import Differences, permuted
from residual_mpc.comparison.settings import ContrastSettings
from residual_mpc.comparison.units import Units

SETTINGS = replace(ContrastSettings(), lots=300)
DRAWS = 150


def units(runs: int, each: int, conditions: np.ndarray | None = None) -> Units:
    """So many runs in each set, cut into so many stretches each."""
    run = np.repeat(np.arange(2 * runs), each)
    there = np.zeros((len(run), 0)) if conditions is None else conditions
    return Units(np.arange(len(run)), run >= runs, run, there)


def differences_of(estimates: np.ndarray, given: Units, settings: ContrastSettings = SETTINGS) -> Differences:
    """Of hypotheses with these estimates (U, N) in units that all tell equally much."""
    equal = np.ones_like(estimates)
    return permuted(equal, -estimates, equal, given, settings)


@pytest.mark.parametrize("runs", [4, pytest.param(12, marks=pytest.mark.slow)])
@pytest.mark.parametrize("tails", ["normal", pytest.param("heavy", marks=pytest.mark.slow)])
def test_false_alarms_over_many_hypotheses(runs: int, tails: str) -> None:
    rng, given = np.random.default_rng(1), units(runs, 24 // runs)
    draw = rng.standard_normal if tails == "normal" else rng.standard_cauchy
    p = np.array([differences_of(draw((given.count, 20)), given).p.min() for _ in range(DRAWS)])
    for level in (0.05, 0.2):
        assert (p <= level).mean() <= level + 3.0 * np.sqrt(level * (1.0 - level) / DRAWS)
    assert (p <= 0.2).mean() > 0.05


def test_an_outlying_stretch_hides_no_difference() -> None:
    rng, given = np.random.default_rng(2), units(12, 1)
    found = []
    for _ in range(40):
        estimates = rng.standard_normal(given.count) + 3.0 * given.later
        estimates[3] = 500.0
        found.append(differences_of(estimates[:, None], given))
    assert np.mean([f.p[0] <= 0.02 for f in found]) > 0.9
    assert np.mean([f.dose[0] for f in found]) == pytest.approx(3.0, abs=0.4)


@pytest.mark.parametrize("runs", [3, pytest.param(12, marks=pytest.mark.slow)])
def test_at_least_four_in_five_changes_of_the_smallest_visible_size_are_found(runs: int) -> None:
    rng, given = np.random.default_rng(3), units(runs, 36 // runs)
    shape = (given.count, 10)
    size = float(np.median([differences_of(rng.standard_normal(shape), given).visible for _ in range(20)]))
    found = 0
    for _ in range(DRAWS):
        estimates = rng.standard_normal(shape)
        estimates[:, 0] += size * given.later
        found += bool(differences_of(estimates, given).p[0] <= SETTINGS.level)
    assert found / DRAWS > 0.7
    small = 0.25 * size * given.later[:, None]
    smaller = [differences_of(rng.standard_normal(shape) + small, given) for _ in range(20)]
    assert np.mean([f.p[0] <= SETTINGS.level for f in smaller]) < 0.5


def test_what_the_conditions_explain_is_no_change() -> None:
    """Later stretches are driven faster, and the estimate grows with speed."""
    rng = np.random.default_rng(4)
    p, plain = [], []
    for _ in range(60):
        speed = rng.standard_normal(24) + 1.5 * (np.arange(24) >= 12)
        estimates = (2.0 * speed + 0.5 * rng.standard_normal(24))[:, None]
        p.append(differences_of(estimates, units(12, 1, speed[:, None])).p[0])
        plain.append(differences_of(estimates, units(12, 1)).p[0])
    assert np.mean(np.array(p) <= 0.05) <= 0.15 and np.mean(np.array(plain) <= 0.05) > 0.5


def test_runs_that_differ_are_the_observations() -> None:
    """Three runs a set, each with a value of its own: twelve stretches of a run are one observation."""
    rng, given = np.random.default_rng(5), units(3, 12)
    draws = [rng.standard_normal(6)[given.run] + 0.1 * rng.standard_normal(given.count) for _ in range(100)]
    p = np.array([differences_of(d[:, None], given).p[0] for d in draws])
    assert (p <= 0.05).mean() <= 0.12


def test_with_few_stretches_the_p_is_students() -> None:
    given = units(4, 1)
    estimates = np.random.default_rng(6).standard_normal((8, 3)) + 2.0 * given.later[:, None]
    found = differences_of(estimates, given, replace(SETTINGS, clip=1e6))
    right = ttest_ind(estimates[given.later], estimates[~given.later]).pvalue
    assert found.p == pytest.approx(np.minimum(1.0, 3.0 * right), rel=1e-6)


def test_a_hypothesis_by_itself_is_not_diluted_by_the_others() -> None:
    """Its p is uniform where nothing differs, and tells a difference that is lost among two hundred others."""
    rng, given = np.random.default_rng(7), units(12, 1)
    nothing = np.array([differences_of(rng.standard_normal((given.count, 1)), given).alone[0] for _ in range(DRAWS)])
    for level in (0.05, 0.2):
        assert (nothing <= level).mean() == pytest.approx(level, abs=3.0 * np.sqrt(level * (1.0 - level) / DRAWS))
    estimates = rng.standard_normal((given.count, 200))
    estimates[:, -1] += 1.6 * given.later
    found = differences_of(estimates, given)
    assert found.alone[-1] < 0.01 < 0.05 < found.p[-1]


def nine_runs() -> Units:
    """Five runs before, four after, three stretches each."""
    run = np.repeat(np.arange(9), 3)
    return Units(np.arange(27), run >= 5, run, np.zeros((27, 0)))


@pytest.mark.slow
def test_nine_runs_whose_stretches_are_alike_raise_no_more_alarms_than_the_level() -> None:
    """A hundred hypotheses, of some of which the runs seem alike by chance."""
    rng, given = np.random.default_rng(8), nine_runs()
    mixed = np.random.default_rng(9).standard_normal((20, 100))
    p = []
    for _ in range(DRAWS):
        runs, stretches = rng.standard_normal((9, 20))[given.run], rng.standard_normal((given.count, 20))
        p.append(differences_of((runs + 0.4 * stretches) @ mixed, given).p.min())
    for level in (0.02, 0.1):
        assert (np.array(p) <= level).mean() <= level + 2.0 * np.sqrt(level * (1.0 - level) / DRAWS)


@pytest.mark.parametrize(
    ("varying", "draws"), [(slice(0, 4), DRAWS), pytest.param(slice(39, 40), 2 * DRAWS, marks=pytest.mark.slow)]
)
def test_hypotheses_that_runs_differ_in_are_not_tested_as_if_they_did_not(varying: slice, draws: int) -> None:
    """Four among forty, or the last one, which is the size of the residuals."""
    rng, given = np.random.default_rng(12), nine_runs()
    p = []
    for _ in range(draws):
        estimates = rng.standard_normal((given.count, 40))
        own = estimates[:, varying].shape[1]
        estimates[:, varying] = rng.standard_normal((9, own))[given.run] + 0.2 * rng.standard_normal((27, own))
        found = differences_of(estimates, given)
        p.append(found.p.min() if own > 1 else found.alone[-1])
    for level in (0.04, 0.1):
        assert (np.array(p) <= level).mean() <= level + 2.0 * np.sqrt(level * (1.0 - level) / draws)


def test_nine_runs_tell_a_change_that_is_larger_than_they_differ() -> None:
    rng, given = np.random.default_rng(10), nine_runs()
    found = []
    for _ in range(20):
        estimates = np.repeat(rng.standard_normal((9, 50)), 3, axis=0)
        estimates[:, 0] += 8.0 * given.later
        found.append(differences_of(estimates, given))
    assert np.mean([f.p[0] <= 0.016 for f in found]) > 0.8
    assert all(f.p[0] < f.p[1:].min() for f in found)


def test_a_stretch_in_which_the_model_misses_much_tells_little() -> None:
    """Two runs in which the prediction diverges, with estimates far off, among ten that agree."""
    rng, given = np.random.default_rng(11), units(6, 2)
    poor = np.isin(given.run, [2, 9])
    misfit = np.where(poor, 400.0, 1.0)[:, None] * np.ones((1, 20))
    found = []
    for weigh in (misfit, np.ones_like(misfit)):
        p = []
        for _ in range(30):
            estimates = rng.standard_normal((given.count, 20)) * np.sqrt(misfit)
            estimates[:, 0] += 4.0 * given.later
            one = np.ones_like(estimates)
            p.append(permuted(one, -estimates, weigh, given, SETTINGS).p[0])
        found.append(np.mean(np.array(p) <= 0.02))
    assert found[0] > 0.9 and found[0] > found[1] + 0.2
