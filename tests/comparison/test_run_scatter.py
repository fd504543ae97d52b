"""By how much runs scatter more than their stretches, on estimates drawn directly."""

from __future__ import annotations

import numpy as np
import pytest

from residual_mpc.comparison.run_scatter import run_scatter

RUN = np.repeat(np.arange(6), 4)
LATER = RUN >= 3


def drawn(of_runs: float, seed: int, hypotheses: int = 100) -> np.ndarray:
    """(24, N) estimates of six runs, four stretches each; of_runs: standard deviation of the runs, that of the
    stretches being 1."""
    rng = np.random.default_rng(seed)
    return of_runs * rng.standard_normal((6, hypotheses))[RUN] + rng.standard_normal((24, hypotheses))


def test_stretches_that_are_independent_keep_their_degrees_of_freedom() -> None:
    scatter = [run_scatter(drawn(0.0, seed), RUN, LATER, 1) for seed in range(20)]
    assert np.median([s.ratio for s in scatter]) < 1.15
    assert np.median([s.freedom for s in scatter]) > 18.0


@pytest.mark.parametrize("of_runs", [1.0, 3.0])
def test_runs_that_differ_are_the_observations(of_runs: float) -> None:
    """With v the variance of the runs, a mean square of 1 + 4 v has four degrees of freedom, and one of 1 has 18."""
    of_sums = 1.0 + 4.0 * of_runs**2
    right = of_sums / ((4.0 * of_sums + 18.0) / 22.0)
    scatter = [run_scatter(drawn(of_runs, seed), RUN, LATER, 1) for seed in range(20)]
    assert np.median([s.ratio for s in scatter]) == pytest.approx(right, rel=0.25)
    assert np.median([s.freedom for s in scatter]) < (16.0 if of_runs == 1.0 else 6.0)


def test_a_hypothesis_whose_runs_seem_alike_by_chance_is_no_exception() -> None:
    """Alone, its variance between the runs would be a tenth of what the stretches imply."""
    left = drawn(3.0, 1)
    left[:, 0] = np.tile([1.5, -0.5, 0.5, -1.5], 6)
    left[:4, 0] += 0.1
    among = run_scatter(left, RUN, LATER, 1)
    assert run_scatter(left[:, :1], RUN, LATER, 1).ratio[0] == 1.0
    assert among.ratio[0] > 2.0


def test_one_stretch_a_run_has_no_more_to_tell() -> None:
    scatter = run_scatter(drawn(1.0, 2)[::4], np.arange(6), np.arange(6) >= 3, 1)
    assert (scatter.ratio == 1.0).all() and (scatter.freedom == 4.0).all()


def test_hypotheses_of_which_few_stretches_tell_anything_say_nothing_of_the_others() -> None:
    """A tenth of the hypotheses act in one stretch of each set only, so their runs seem alike to the last digit."""
    left = drawn(0.0, 3)
    few = left.copy()
    few[:, :10] = 0.0
    few[[0, 12], :10] = 1.0
    few[[0, 12], :10] += 1e-15 * np.arange(10)
    alone, among = run_scatter(left[:, 10:], RUN, LATER, 1), run_scatter(few, RUN, LATER, 1)
    assert among.freedom[10:] == pytest.approx(alone.freedom)
    assert among.ratio[10:] == pytest.approx(alone.ratio)
