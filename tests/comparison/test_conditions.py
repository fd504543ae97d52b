"""Which of the conditions of a stretch the test takes into account."""

import numpy as np
from diagnosis.linear import windows

from residual_mpc.comparison.conditions import balanced, driving_of

LATER = np.arange(80) >= 40


def test_components_that_differ_between_the_sets_are_left_out() -> None:
    rng = np.random.default_rng(0)
    columns = rng.standard_normal((80, 4))
    columns[:, 1] += 2.0 * LATER
    kept = balanced(columns, LATER, 2, 0.8)
    np.testing.assert_array_equal(kept, columns[:, [0, 2]])


def test_a_controller_that_answers_a_change_hides_nothing() -> None:
    """Commands larger by 10 % after a change, the same motion in every run: the component that tells the sets apart is
    no condition."""
    rng = np.random.default_rng(1)
    command = np.where(LATER, 1.1, 1.0) + 0.001 * rng.standard_normal(80)
    assert balanced(command[:, None], LATER, 5, 0.5).shape == (80, 0)


def test_no_component_without_enough_stretches() -> None:
    assert balanced(np.random.default_rng(2).standard_normal((80, 3)), LATER, 0, 0.5).shape == (80, 0)


def test_the_components_are_uncorrelated_and_of_unit_variance() -> None:
    components = driving_of(windows(6, 12.0))
    covariance = components.T @ components / len(components)
    np.testing.assert_allclose(covariance, np.eye(components.shape[1]), atol=1e-9)
