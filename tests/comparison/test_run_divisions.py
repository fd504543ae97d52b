"""The exact tests over all divisions of a few runs, and p of two tests together."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from residual_mpc.comparison import contrast
from residual_mpc.comparison.contrast import Estimates
from residual_mpc.comparison.permutation import permuted
from residual_mpc.comparison.run_divisions import combined, p_of_divisions, p_of_runs
from residual_mpc.comparison.settings import ContrastSettings
from residual_mpc.comparison.units import Units, build_units

STRETCHES, CHANGES = 3, 20
SETTINGS = ContrastSettings()


def units_of(runs: int, later: tuple[int, ...]) -> Units:
    run = np.repeat(np.arange(runs), STRETCHES)
    return build_units(np.arange(len(run)), np.isin(run, later), run, np.zeros((len(run), 0)))


def estimates(runs: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """size, score, misfit (U, N): steady errors of each run in directions that resemble each other, with heavy tails,
    and far more in the first of them than in the others."""
    own = rng.standard_t(2.0, (runs, 1)) * np.geomspace(30.0, 1.0, CHANGES) + rng.standard_normal((runs, CHANGES))
    size = rng.uniform(50.0, 200.0, (runs * STRETCHES, CHANGES))
    return size, size * np.repeat(own, STRETCHES, axis=0), np.ones((runs * STRETCHES, CHANGES))


@pytest.mark.parametrize("runs", [8, 9])
def test_p_is_exact_whatever_runs_differ_in(runs: int) -> None:
    """Over all divisions of any runs, p is at most x in a share x of them at most, and nearly as often."""
    parts = estimates(runs, np.random.default_rng(runs))
    every = [p_of_divisions(*parts, units_of(runs, c), SETTINGS) for c in combinations(range(runs), runs // 2)]
    p = np.array(every, dtype=float)
    for level in (0.03, 0.1, 0.3, 1.0):
        assert level - 4.0 / len(p) <= (p <= level).mean() <= level


def test_a_change_that_explains_more_than_in_any_other_division_has_the_smallest_p() -> None:
    size, score, misfit = estimates(8, np.random.default_rng(0))
    units = units_of(8, (4, 5, 6, 7))
    score[units.later, 7] += 2000.0 * size[units.later, 7]
    assert p_of_divisions(size, score, misfit, units, SETTINGS) == pytest.approx(2.0 / 70.0)


def test_what_a_poor_fit_misses_counts_for_less() -> None:
    """A stretch in which the model misses much else tells little of a change."""
    size, score, misfit = np.full((24, 1), 100.0), np.zeros((24, 1)), np.ones((24, 1))
    units = units_of(8, (4, 5, 6, 7))
    score[units.later] = 100.0
    spoilt = units.run == 0
    score[spoilt] = 1000.0
    assert p_of_divisions(size, score, misfit, units, SETTINGS) > 0.1  # type: ignore[operator]
    misfit[spoilt] = 1e4
    assert p_of_divisions(size, score, misfit, units, SETTINGS) == pytest.approx(2.0 / 70.0)


def test_too_few_and_too_many_runs_are_not_divided() -> None:
    for runs in (6, 20):
        parts = estimates(runs, np.random.default_rng(1))
        assert p_of_divisions(*parts, units_of(runs, tuple(range(runs // 2))), SETTINGS) is None


def test_two_independent_tests_together_alarm_as_often_as_one() -> None:
    p = np.random.default_rng(2).random((2, 200_000))
    both = np.array([combined(p[:1, i], float(p[1, i]))[0] for i in range(20_000)])
    for level in (0.01, 0.04, 0.3):
        assert (both <= level).mean() == pytest.approx(level, abs=3.0 * np.sqrt(level / 20_000))
    np.testing.assert_array_equal(combined(p[0], None), p[0])


def test_a_comparison_uses_both_tests() -> None:
    """The same differences are the less significant, the more other divisions explain as much."""
    size, score, misfit = estimates(8, np.random.default_rng(3))
    units = units_of(8, (4, 5, 6, 7))
    score[units.later] += 0.5 * size[units.later]
    two = [np.repeat(x, 2, axis=1) for x in (size, score, misfit)]  # each probe has two directions
    more = [np.column_stack([x, np.ones(24)]) for x in two]  # and the size of the residuals is the last
    of = Estimates(*more, probes=((None, {}),) * CHANGES)  # type: ignore[arg-type]
    alone = contrast.tested(of, units, replace(SETTINGS, of_runs=1e-6))
    p = p_of_divisions(*two, units, SETTINGS)
    for one, other in zip(alone.told, contrast.tested(of, units, SETTINGS).told, strict=True):
        assert other.p == pytest.approx(float(combined(np.array([one.p]), p)[0]))


def of_differences(parts: tuple[np.ndarray, np.ndarray, np.ndarray], units: Units) -> np.ndarray | None:
    """p of each change from the standardised differences."""
    found = permuted(*(np.column_stack([x, np.ones(len(x))]) for x in parts), units, replace(SETTINGS, lots=20))
    return p_of_runs(found, units, SETTINGS)


def test_p_of_the_differences_is_exact() -> None:
    """Over all divisions of nine runs, the smallest p is at most x in a share x of them at most, and nearly as
    often."""
    size, score, misfit = estimates(9, np.random.default_rng(4))
    parts = size, score + 30.0 * size * np.random.default_rng(5).standard_normal(size.shape), misfit
    every = [of_differences(parts, units_of(9, c)) for c in combinations(range(9), 4)]
    p = np.array([of_all.min() for of_all in every if of_all is not None])
    assert len(p) == 126
    for level in (0.03, 0.1, 0.3, 1.0):
        assert level - 4.0 / len(p) <= (p <= level).mean() <= level


def test_a_small_change_is_found_beside_large_steady_errors_of_the_runs() -> None:
    """It explains far less than what the runs differ in, so the drop alone does not see it."""
    size, score, misfit = estimates(10, np.random.default_rng(6))
    units = units_of(10, (5, 6, 7, 8, 9))
    score[:, -1] = size[:, -1] * (np.random.default_rng(7).standard_normal(30) + 5.0 * units.later)
    p = of_differences((size, score, misfit), units)
    assert p is not None and p[-1] == p.min() == pytest.approx(2.0 / 252.0)
    assert p_of_divisions(size, score, misfit, units, SETTINGS) > 0.1  # type: ignore[operator]


def test_so_few_runs_that_no_division_is_rare_are_judged_by_their_stretches() -> None:
    assert of_differences(estimates(8, np.random.default_rng(8)), units_of(8, (4, 5, 6, 7))) is None


def test_many_divisions_are_drawn_at_random() -> None:
    """Of 3432 divisions of 14 runs at most 500 are tried, so no p is smaller than 1 in 500."""
    size, score, misfit = estimates(14, np.random.default_rng(9))
    units = units_of(14, tuple(range(7, 14)))
    score[units.later, 3] += 1000.0 * size[units.later, 3]
    p = of_differences((size, score, misfit), units)
    assert p is not None and p[3] == pytest.approx(1.0 / 500.0)


def test_of_two_tests_the_smaller_p_counts_twice(monkeypatch: pytest.MonkeyPatch) -> None:
    """One of them at a time is the smaller one; the size of the residuals has only the other."""
    size, score, misfit = estimates(10, np.random.default_rng(6))
    units = units_of(10, (5, 6, 7, 8, 9))
    more = [np.column_stack([np.repeat(x, 2, axis=1), np.ones(30)]) for x in (size, score, misfit)]
    of = Estimates(*more, probes=((None, {}),) * CHANGES)  # type: ignore[arg-type]
    alone = contrast.tested(of, units, replace(SETTINGS, of_differences=1e-6))
    for exact in (0.001, 0.9):
        monkeypatch.setattr(contrast, "p_of_runs", lambda *given, p=exact: np.full(2 * CHANGES, p))
        both = contrast.tested(of, units, SETTINGS)
        assert both.scatter_p == alone.scatter_p
        for one, other in zip(alone.told, both.told, strict=True):
            assert other.p == pytest.approx(min(1.0, 2.0 * min(one.p, exact / (1.0 - SETTINGS.of_size))))
