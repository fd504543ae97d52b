"""How far the gap shrinks: the share, its interval, and predictions by fits that have not seen what they predict."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from diagnosis.linear import GAIN, ROVER, SCALE, Linear, fitted, space_of, white, windows
from oracles.rover_log import SIGMA, rover_run

from residual_mpc.diagnosis.data.dataset import Dataset, build_dataset
from residual_mpc.diagnosis.data.gap import Scales, gap_of, measure_scales
from residual_mpc.diagnosis.fit.cross_validation import expected_errors, fold_values, folds_of
from residual_mpc.diagnosis.fit.evidence import blocks_of
from residual_mpc.diagnosis.fit.settings import FitSettings
from residual_mpc.diagnosis.predict.problem import build_problem
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.diagnosis.results.settings import ResultSettings
from residual_mpc.diagnosis.results.shrink import Shrink, expected_shrink, shrink_of

TUNED, FITTED = ResultSettings(), FitSettings()

MANY, FEW, HELD = windows(14, 4.0), windows(2, 30.0), windows(9, 4.0)
DRAWS = 60


def scales_of(data: Dataset) -> Scales:
    return Scales(np.ones(3), np.zeros(3, dtype=bool), np.ones(3, dtype=bool))


def errors(data: Dataset, unit: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Before and after (W, M, C): each unit (a run, or a stretch of time) has its own share of the error explained."""
    left = rng.uniform(0.1, 0.6, unit.max() + 1)[unit]
    before = rng.standard_normal(data.y.shape)
    return before, left[:, None, None] * rng.standard_normal(data.y.shape)


def run_of(data: Dataset) -> np.ndarray:
    return data.run


def measured(data: Dataset, unit: np.ndarray, rng: np.random.Generator) -> Shrink:
    before, after = errors(data, unit, rng)
    return shrink_of(data, scales_of(data), before, after, rng, TUNED)


def test_the_shrink_is_one_less_the_ratio_of_the_gaps() -> None:
    before, after = errors(MANY, MANY.run, np.random.default_rng(0))
    scales = measure_scales(MANY)
    ratio = gap_of(MANY, scales, after).total / gap_of(MANY, scales, before).total
    assert shrink_of(MANY, scales, before, after, np.random.default_rng(1), TUNED).value == pytest.approx(1.0 - ratio)


@pytest.mark.parametrize("left", [1.0, 0.25])
def test_where_every_window_shrinks_alike_the_interval_is_a_point(left: float) -> None:
    before, _ = errors(MANY, MANY.run, np.random.default_rng(0))
    found = shrink_of(MANY, scales_of(MANY), before, left * before, np.random.default_rng(1), TUNED)
    assert (found.value, *found.ci95) == pytest.approx((1.0 - left,) * 3)


def stretch_of(data: Dataset) -> np.ndarray:
    return blocks_of(data, FITTED)


@pytest.mark.parametrize(("data", "unit_of"), [(MANY, run_of), (FEW, stretch_of)])
def test_the_interval_is_as_wide_as_the_shrink_scatters(
    data: Dataset, unit_of: Callable[[Dataset], np.ndarray]
) -> None:
    """Among sets of runs drawn anew: what a run (or a stretch of time) shares makes it one observation, not many."""
    rng = np.random.default_rng(2)
    found = [measured(data, unit_of(data), rng) for _ in range(DRAWS)]
    spread = 1.96 * np.std([f.value for f in found], ddof=1)
    half = np.mean([0.5 * (f.ci95[1] - f.ci95[0]) for f in found])
    assert 0.7 < half / spread < 1.4
    centre = np.mean([f.value for f in found])
    assert np.mean([f.ci95[0] < centre < f.ci95[1] for f in found]) > 0.85


def test_what_is_foretold_counts_that_the_held_out_runs_are_few_as_well() -> None:
    rng = np.random.default_rng(3)
    said, came = [], []
    for _ in range(DRAWS):
        before, after = errors(MANY, MANY.run, rng)
        said.append(expected_shrink(MANY, HELD, scales_of(MANY), before, after, rng, TUNED))
        came.append(measured(HELD, HELD.run, rng).value)
    spread = 1.96 * np.std(np.array([s.value for s in said]) - came, ddof=1)
    half = np.mean([0.5 * (s.ci95[1] - s.ci95[0]) for s in said])
    assert 0.7 < half / spread < 1.4
    inside = np.mean([s.ci95[0] <= c <= s.ci95[1] for s, c in zip(said, came, strict=True)])
    assert inside > 0.85


def test_the_fewer_runs_are_held_out_the_wider_is_what_is_foretold() -> None:
    before, after = errors(MANY, MANY.run, np.random.default_rng(4))

    def width(held: Dataset) -> float:
        low, high = expected_shrink(MANY, held, scales_of(MANY), before, after, np.random.default_rng(5), TUNED).ci95
        return high - low

    own = shrink_of(MANY, scales_of(MANY), before, after, np.random.default_rng(5), TUNED).ci95
    one = HELD.take(HELD.run == 0)
    assert width(one) > 1.5 * width(HELD) > 1.2 * (own[1] - own[0])


def test_the_same_seed_gives_the_same_interval() -> None:
    once, again = (measured(MANY, MANY.run, np.random.default_rng(6)) for _ in range(2))
    assert once == again


def test_a_linear_fit_without_a_fold_is_the_refit() -> None:
    """One Gauss-Newton step from the whole, against least squares on the other windows."""
    rng = np.random.default_rng(7)
    columns = dict(zip((SCALE, GAIN), rng.standard_normal((2, FEW.count, 20)), strict=True))
    problem = Linear(FEW, space_of(FEW), columns, {SCALE: 1.2, GAIN: 0.9}, white(FEW, rng, 20))
    fit = fitted(problem, {SCALE: 1.0, GAIN: 1.0})
    folds = folds_of(FEW, FITTED)
    for k, values in enumerate(fold_values(fit, folds)):
        rest = folds != k
        j = np.stack([columns[SCALE][rest].ravel(), columns[GAIN][rest].ravel()], axis=1)
        alone = np.array([1.2, 0.9]) - np.linalg.lstsq(j, problem.noise[rest].ravel(), rcond=None)[0]
        assert [values[SCALE], values[GAIN]] == pytest.approx(alone, abs=1e-6)
    assert len({v[SCALE] for v in fold_values(fit, folds)}) == folds.max() + 1  # each its own


def test_folds_split_no_run_of_many_and_no_stretch_of_time_of_few() -> None:
    for data, unit in ((MANY, MANY.run), (FEW, stretch_of(FEW))):
        folds = folds_of(data, FITTED)
        assert set(folds) == set(range(6))
        assert all(len(set(folds[unit == u])) == 1 for u in np.unique(unit))


def test_a_window_is_predicted_by_a_fit_that_has_not_seen_its_run() -> None:
    """Five rovers of one track width and a sixth of another: its errors are those of the five's own fit."""
    runs = [rover_run(f"r{k}", {"track_width": {"scale": 1.1 if k < 5 else 1.4}}, 4.0, seed=k) for k in range(6)]
    data = build_dataset(runs, [ROVER] * 6, SIGMA)
    fits = []
    for windows_seen in (data, data.take(data.run != 5)):
        problem = build_problem(windows_seen, space_of(data), data.sigma)
        fits.append(fitted(problem, {SCALE: 1.0}))
    odd = data.take(data.run == 5)
    whole, without = (odd.y - predict(odd, space_of(data).settings([f.values]))[0] for f in fits)
    scales = measure_scales(data)
    size = gap_of(odd, scales, expected_errors(data, space_of(data), fits[0], FITTED)[data.run == 5]).total
    assert size == pytest.approx(gap_of(odd, scales, without).total, rel=0.1)
    assert size > 1.15 * gap_of(odd, scales, whole).total
