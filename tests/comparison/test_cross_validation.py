"""Folds, the windows that a fold leaves to a fit, and the refit on them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from comparison.test_change_search import DELAY, fitted

from residual_mpc.comparison.cross_validation import clear_of, folds_of, refitted
from residual_mpc.diagnosis.fit.least_squares import fit_all
from residual_mpc.diagnosis.predict.problem import part_of


def test_runs_are_dealt_where_each_set_has_enough_and_stretches_elsewhere() -> None:
    run, later = np.repeat(np.arange(8), 3), np.repeat([False, True], 12)
    stretch = np.arange(24)
    by_run, by_stretch = folds_of(stretch, run, later, 4), folds_of(stretch, run // 4, later, 4)
    assert by_run.count == by_stretch.count == 4
    assert all(len(set(by_run.number[run == i])) == 1 for i in range(8))
    for folds in (by_run, by_stretch):
        assert all(set(folds.number[side]) == set(range(4)) for side in (later, ~later))
    assert set(by_stretch.number[run == 0]) == {0, 1, 2}


def test_no_more_folds_than_a_set_has_stretches() -> None:
    later = np.array([False] * 8 + [True] * 3)
    assert folds_of(np.arange(11), later.astype(int), later, 4).count == 3


def test_the_windows_of_a_fold_and_no_others_are_kept_from_the_fit() -> None:
    data = fitted({}, {})[0].data
    folds = folds_of(data.run, data.run, data.run >= 3, 3)
    for fold in range(3):
        assert (clear_of(fold, folds, data, data) == (folds.number != fold)).all()
    between = replace(data, start=data.start + 0.5)  # each overlaps two windows of its run
    assert (clear_of(0, folds, data, between) == (folds.number != 0)).all()


def test_a_refit_is_the_fit_on_the_windows_it_sees() -> None:
    """Near enough: the whole fit's derivatives are used, and the numbers move away from the whole fit's."""
    problem, _, found = fitted({}, {"command_delay": {"delay": 0.12}})
    fit = found[DELAY].fit
    mask = problem.data.run % 3 != 0
    (near,) = refitted(problem, fit, [mask])
    exact = fit_all(part_of(problem, mask), [fit.values])[0].values
    assert any(near[k] != fit.values[k] for k in fit.knobs)
    for k in fit.knobs:
        assert abs(near[k] - exact[k]) < 0.3 * abs(fit.values[k] - exact[k]) + 1e-4
