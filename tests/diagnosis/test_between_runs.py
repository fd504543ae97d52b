"""Intervals where runs disagree: they cover as often as they say, and stay as they are where runs agree."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from residual_mpc.diagnosis.fit.evidence import T95, covariance
from residual_mpc.diagnosis.fit.least_squares import Fit
from residual_mpc.diagnosis.results.between_runs import sigma_between_runs
from residual_mpc.diagnosis.results.settings import ResultSettings
from residual_mpc.models.settings import Knob

KNOBS = (Knob("actuator_gain", None, "gain"), Knob("command_delay", None, "delay"))
TRUE = np.array([0.8, 0.05])
WINDOWS, SAMPLES = 12, 20  # of a run


def fitted(
    runs: int, apart: float, rng: np.random.Generator, shown: np.ndarray | float = 1.0
) -> tuple[Fit, np.ndarray]:
    """A linear fit of two numbers, of which the first differs between runs with a standard deviation of `apart`; the
    windows' runs. shown: how much each run excites the first number."""
    run = np.repeat(np.arange(runs), WINDOWS)
    design = rng.normal(size=(len(run), SAMPLES, 2)) * rng.uniform(0.5, 1.5, size=(runs, 1, 1))[run]
    design[:, :, 0] *= np.broadcast_to(shown, runs)[run, None]
    own = TRUE + np.stack([apart * rng.normal(size=runs), np.zeros(runs)], axis=1)
    y = np.einsum("wnp,wp->wn", design, own[run]) + 0.5 * rng.normal(size=(len(run), SAMPLES))
    found = np.linalg.lstsq(design.reshape(-1, 2), y.ravel(), rcond=None)[0]
    r = np.einsum("wnp,p->wn", design, found) - y
    values = dict(zip(KNOBS, found.tolist(), strict=True))
    return Fit((), KNOBS, values, np.ones(2), float(np.sum(r * r)), r, design, np.zeros(2, dtype=bool)), run


def intervals(
    runs: int, apart: float, rng: np.random.Generator, shown: np.ndarray | float = 1.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(2,) errors, half-widths as stated, and half-widths as if no run differed."""
    fit, run = fitted(runs, apart, rng, shown)
    blocks = np.arange(len(run))
    within = np.sqrt(np.diag(covariance(fit, blocks)))
    sigma = sigma_between_runs(fit, run, within, len(blocks), ResultSettings())
    return np.array(list(fit.values.values())) - TRUE, T95 * sigma, T95 * within


@pytest.mark.parametrize("runs", [5, pytest.param(10, marks=pytest.mark.slow)])
def test_intervals_cover_where_a_number_differs_between_runs(runs: int) -> None:
    rng = np.random.default_rng(3)
    drawn = [intervals(runs, 0.1, rng) for _ in range(400)]
    stated = np.mean([np.abs(e) <= half for e, half, _ in drawn], axis=0)
    as_if = np.mean([np.abs(e) <= plain for e, _, plain in drawn], axis=0)
    assert as_if[0] < 0.6  # what blocks of seconds alone would claim as 95 %
    assert stated[0] >= 0.9
    assert stated[1] >= 0.92


@pytest.mark.parametrize("runs", [4, 10, *(pytest.param(n, marks=pytest.mark.slow) for n in (5, 40))])
def test_they_stay_as_they_are_where_runs_agree(runs: int) -> None:
    rng = np.random.default_rng(4)
    drawn = [intervals(runs, 0.0, rng) for _ in range(300)]
    ratio = np.array([half / plain for _, half, plain in drawn])
    assert np.median(ratio) == 1.0
    assert np.mean(ratio > 1.0) <= 1.3 * ResultSettings().causes.agree


@pytest.mark.parametrize("others", [0.3, 0.1, 0.01, 1e-6, 0.0])
def test_one_run_that_shows_a_number_alone_does_not_disagree_with_the_others(others: float) -> None:
    """Without it the rest says next to nothing of the number, whatever that is."""
    rng, shown = np.random.default_rng(7), np.array([1.0, *(others,) * 4])
    drawn = [intervals(5, 0.0, rng, shown) for _ in range(200)]
    ratio = np.array([half / plain for _, half, plain in drawn])
    assert np.median(ratio[:, 0]) == 1.0 and np.quantile(ratio[:, 0], 0.9) < 3.0


@pytest.mark.parametrize("runs", [1, 3])
def test_too_few_runs_say_nothing(runs: int) -> None:
    _, half, plain = intervals(runs, 0.1, np.random.default_rng(5))
    np.testing.assert_array_equal(half, plain)


def test_a_number_at_its_bound_keeps_what_it_has() -> None:
    fit, run = fitted(6, 0.1, np.random.default_rng(6))
    held = replace(fit, held=np.array([True, False]))
    within = np.array([0.3, 1e-6])
    sigma = sigma_between_runs(held, run, within, len(run), ResultSettings())
    assert sigma[0] == within[0]
    assert sigma[1] > within[1]
