"""Which of the conditions of a stretch the test takes into account."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from diagnosis.linear import windows

from residual_mpc.comparison.conditions import balanced, driven_differently, driving_of, unlike_of

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


@pytest.mark.parametrize(
    ("size", "speed", "said"),
    [(1.0, 1.0, ""), (1.4, 1.0, ""), (2.0, 1.0, "vary 2 times as much and change 2 times as fast"),
     (1.0, 3.0, "change 3 times as fast"), (0.5, 2.0, "vary 0.5 times as much")],
)  # fmt: skip
def test_commands_that_are_larger_or_faster_after_are_said_to_be(size: float, speed: float, said: str) -> None:
    """Forty windows with two periods of a sine before, larger and faster by these factors after; an actuator that is
    never driven says nothing."""
    t = 2.0 * np.pi * np.arange(2000) / 1000.0
    command = np.where(LATER[:, None], size * np.sin(speed * t), np.sin(t))
    drive = SimpleNamespace(command=np.stack([command, 0.0 * command], axis=2), lead=0, dt=0.01)
    data: Any = SimpleNamespace(count=80, blocks=[SimpleNamespace(drive=drive, where=slice(0, 80))])
    assert driven_differently(data, LATER, 1.5) == said


@pytest.mark.parametrize(("size", "speed", "columns"), [(1.4, 1.0, 0), (0.5, 2.0, 1), (3.0, 1.0, 2)])
def test_how_the_sets_are_driven_differently_is_a_condition(size: float, speed: float, columns: int) -> None:
    """Each measure of the commands whose ratio reaches 1.5 is a column that is larger or smaller after."""
    t = 2.0 * np.pi * np.arange(2000) / 1000.0
    vary = np.tile(np.linspace(0.9, 1.1, 40), 2)[:, None]  # windows of a set are not all alike
    command = vary * np.where(LATER[:, None], size * np.sin(speed * t), np.sin(t))
    drive = SimpleNamespace(command=command[:, :, None], lead=0, dt=0.01)
    data: Any = SimpleNamespace(count=80, blocks=[SimpleNamespace(drive=drive, where=slice(0, 80))])
    found = unlike_of(data, LATER, 1.5)
    assert found.shape == (80, columns)
    np.testing.assert_allclose(found.mean(axis=0), 0.0, atol=1e-9)
    for column in found.T:
        assert np.sign(column[LATER].mean()) == (1.0 if size > 1.0 else -1.0)
