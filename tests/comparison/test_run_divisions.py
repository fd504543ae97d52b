"""The exact test over all divisions of a few runs, and p of two tests together."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from residual_mpc.comparison import contrast
from residual_mpc.comparison.contrast import Estimates
from residual_mpc.comparison.run_divisions import combined, p_of_divisions
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
