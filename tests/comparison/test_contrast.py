"""The test between two sets: false alarms at most at the level, and a planted difference is seen."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from diagnosis.linear import GAIN, SCALE, Linear, space_of, windows

from residual_mpc.comparison.contrast import Contrast, contrasts
from residual_mpc.comparison.sets import units_of
from residual_mpc.comparison.settings import ContrastSettings
from residual_mpc.comparison.space import ChangeSpace, change_space
from residual_mpc.comparison.units import Units, build_units
from residual_mpc.diagnosis.fit.least_squares import Fit
from residual_mpc.models.settings import Knob, Values

RUNS, SECONDS, SAMPLES = 8, 12.0, 30
DATA = windows(RUNS, SECONDS)
SPACE: ChangeSpace = change_space(space_of(DATA))
LATER = np.arange(RUNS) >= RUNS // 2
NUMBER = units_of(DATA, LATER, ContrastSettings())
UNITS = build_units(NUMBER, LATER[DATA.run], DATA.run, np.zeros((DATA.count, 0)))
COLUMNS = dict(zip((SCALE, GAIN), np.random.default_rng(5).standard_normal((2, DATA.count, SAMPLES)), strict=True))
START = {SCALE: 1.0, GAIN: 1.0}
DRAWS = 400


def fit_at(problem: Any, values: Values) -> Fit:
    """These values as a fit, though they are not the best."""
    knobs, r = tuple(values), problem.residuals([values])[0]
    jacobian, held = np.stack([problem.columns[k] for k in knobs], axis=-1), np.zeros(len(knobs), dtype=bool)
    return Fit((), knobs, values, np.ones(len(knobs)), float((r**2).sum()), r, jacobian, held)


def contrasts_of(
    sizes: np.ndarray, rng: np.random.Generator, units: Units = UNITS, knobs: tuple[Knob, ...] = (SCALE,)
) -> Any:
    """The contrasts of changes by these knobs, where each window's scale is off by `sizes` (W,)."""
    noise = rng.standard_normal((DATA.count, SAMPLES)) - sizes[:, None] * COLUMNS[SCALE]
    problem: Any = Linear(DATA, SPACE, COLUMNS, START, noise)
    current = fit_at(problem, START)
    probes = [(k._replace(changed=True).term, {k._replace(changed=True): 1.1}) for k in knobs]
    return contrasts(problem, current, units, probes, ContrastSettings()).told


def scatter(by: str, size: float, rng: np.random.Generator) -> np.ndarray:
    """(W,) what is the robot's own in each unit or run."""
    number = UNITS.number if by == "stretch" else DATA.run
    return np.asarray(size * rng.standard_normal(number.max() + 1)[number])


def test_units_are_stretches_of_runs() -> None:
    assert UNITS.count == 24 and UNITS.later.sum() == 12  # 8 runs, three stretches each
    assert (LATER[UNITS.run] == UNITS.later).all()
    assert (UNITS.run[UNITS.number] == DATA.run).all()


@pytest.mark.parametrize(
    ("by", "size"),
    [
        pytest.param("stretch", 0.0, marks=pytest.mark.slow),
        pytest.param("stretch", 0.3, marks=pytest.mark.slow),
        ("run", 0.3),
    ],
)
def test_false_alarms_are_at_most_as_many_as_the_level_says(by: str, size: float) -> None:
    """Also where every stretch, or every run, has a robot of its own."""
    rng = np.random.default_rng(1)
    p = np.array([contrasts_of(scatter(by, size, rng), rng)[0].p for _ in range(DRAWS)])
    for level in (0.03, 0.2):
        most = level + 3.0 * np.sqrt(level * (1.0 - level) / DRAWS)
        assert (p <= level).mean() <= most
    # and not because nothing is ever seen: p without the correction for the share of the level
    assert (p * (1.0 - ContrastSettings().of_size) <= 0.2).mean() > 0.05


@pytest.mark.parametrize("by", ["stretch", "run"])
def test_a_difference_beyond_the_scatter_is_seen(by: str) -> None:
    rng = np.random.default_rng(2)
    later = LATER[DATA.run]
    found: list[Contrast] = [contrasts_of(scatter(by, 0.05, rng) + 0.3 * later, rng)[0] for _ in range(40)]
    assert np.mean([c.p <= 0.03 for c in found]) > 0.9
    # the probe is a tenth larger: the dose is what it has to be multiplied by
    assert 0.1 * np.mean([c.dose for c in found]) == pytest.approx(0.3, abs=0.03)
    assert all(c.drop > 0.0 for c in found)


def test_the_size_of_the_scatter_decides_and_not_the_number_of_samples() -> None:
    """The same difference, and a robot that differs from run to run by as much."""
    rng = np.random.default_rng(3)
    later = LATER[DATA.run]
    p = [contrasts_of(scatter("run", 0.3, rng) + 0.15 * later, rng)[0].p for _ in range(60)]
    assert np.mean(np.array(p) <= 0.03) < 0.3


def test_several_hypotheses_are_paid_for() -> None:
    """With runs of one stretch each, since the scatter of few runs is that of all hypotheses together."""
    rng, apart = np.random.default_rng(6), replace(UNITS, run=np.arange(UNITS.count))
    state = rng.bit_generator.state
    sizes = 0.1 * LATER[DATA.run]
    (alone,) = contrasts_of(sizes, rng, apart)
    rng.bit_generator.state = state
    first, _ = contrasts_of(sizes, rng, apart, knobs=(SCALE, GAIN))
    assert first.z == pytest.approx(alone.z, rel=1e-12) and alone.p <= first.p <= 2.5 * alone.p


def test_nothing_is_told_apart_by_one_unit_a_set() -> None:
    halves = LATER[DATA.run].astype(int)
    few = build_units(halves, LATER[DATA.run], halves, np.zeros((DATA.count, 0)))
    (found,) = contrasts_of(0.5 * LATER[DATA.run], np.random.default_rng(8), few)
    assert found.p == 1.0
