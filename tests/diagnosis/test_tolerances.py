"""Small differences in everything that a hypothesis does not free, marginalised."""

from __future__ import annotations

import numpy as np
import pytest
from oracles.rover_log import SIGMA, rover_run

from plants.diff_drive import DiffDrive
from residual_mpc.diagnosis.data.dataset import build_dataset
from residual_mpc.diagnosis.data.gap import measure_scales
from residual_mpc.diagnosis.fit.least_squares import fit_all
from residual_mpc.diagnosis.fit.marginalisation import carrying, tolerant
from residual_mpc.diagnosis.fit.settings import FitSettings
from residual_mpc.diagnosis.options import Options, PhaseSettings
from residual_mpc.diagnosis.phases.refine import _with_small_differences
from residual_mpc.diagnosis.predict.candidates import build_space
from residual_mpc.diagnosis.predict.problem import Problem, build_problem, part_of, tolerating, whitened
from residual_mpc.diagnosis.predict.settings import PredictSettings, ToleranceSettings
from residual_mpc.diagnosis.predict.tolerances import Tolerances, likeliest_level, small_differences
from residual_mpc.models.settings import Knob, Values

ROVER = DiffDrive("rover", 0.033, 0.16)
LAG = Knob("actuator_lag", None, "time_constant")
RADIUS = Knob("wheel_radius", None, "scale")
LITTLE = {  # a little of everything
    "wheel_radius": {"scale": 1.01},
    "wheel_radius_mismatch": {"ratio": 0.995},
    "track_width": {"scale": 1.02},
    "lateral_slip": {"coefficient": 0.02},
    "dead_zone": {"width": 0.2},
}

LEVELS = ToleranceSettings().levels


def problem_of(faults: dict[str, dict[str, float]], noise: float = 1.0) -> Problem:
    runs = [rover_run(f"r{k}", faults, seed=k, noise=noise) for k in range(3)]
    data = build_dataset(runs, [ROVER] * 3, SIGMA)
    return build_problem(data, build_space(data, ()), data.sigma)


def level_of(problem: Problem) -> float:
    base = fit_all(problem, [{}])[0]
    found = tolerant(carrying(problem, {}, settings=FitSettings()), base, settings=FitSettings()).tolerances
    assert found is not None
    return found.level


def test_a_perfect_robot_has_no_small_differences() -> None:
    assert level_of(problem_of({})) == 0.0


def test_a_robot_that_is_a_little_off_in_everything_has_some() -> None:
    assert level_of(problem_of(LITTLE)) > 0.1


def test_the_cost_is_that_of_the_added_covariance() -> None:
    problem = carrying(problem_of(LITTLE), {}, settings=FitSettings())
    assert problem.tolerances is not None
    wide = tolerating(problem, Tolerances(problem.tolerances.columns, 0.5))
    a, r = 0.5 * whitened(problem, problem.tolerances.columns), problem.residuals([{}])[0].ravel()
    # (I + A A')^-1 by Woodbury's identity
    expected = r @ r - r @ a @ np.linalg.solve(np.eye(a.shape[1]) + a.T @ a, a.T @ r)
    assert np.sum(wide.residuals([{}]) ** 2) == pytest.approx(expected, rel=1e-6)


def test_one_of_several_differs_from_the_number_of_all() -> None:
    """Where both wheels deliver 0.8, one tolerance of the left one's is 0.81, not 1.01."""
    space = problem_of({}).space
    gain, both = (Knob("actuator_gain", target, "gain") for target in ("left", None))
    settings = PredictSettings()

    def rows(values: dict[Knob, float]) -> list[Values]:
        return [d.values for d in small_differences(space, values, settings=settings) if d.knob == gain]

    assert [row[gain] for row in rows({})] == [pytest.approx(1.01)]
    assert [(row[gain], row[both]) for row in rows({both: 0.8})] == [(pytest.approx(0.81), 0.8)]
    assert [row[gain] for row in rows({gain: 0.7})] == [pytest.approx(0.71)]


def test_a_difference_of_another_size_moves_its_own_number_alone() -> None:
    space = problem_of({}).space
    differences = small_differences(space, {}, settings=PredictSettings())
    one = next(d for d in differences if d.knob == Knob("slope", None, "rate"))
    assert one.step == pytest.approx(0.002) and one.own[one.knob] == pytest.approx(one.step)
    assert one.scaled(2.5) == {**one.own, one.knob: pytest.approx(0.005)}


def test_part_of_the_windows_keeps_its_columns() -> None:
    problem = tolerant(
        carrying(problem_of(LITTLE), {}, settings=FitSettings()),
        fit_all(problem_of(LITTLE), [{}])[0],
        settings=FitSettings(),
    )
    keep = np.arange(problem.data.count) % 2 == 0
    few = part_of(problem, keep)
    assert few.tolerances is not None and problem.tolerances is not None
    np.testing.assert_array_equal(few.tolerances.columns, problem.tolerances.columns[keep])
    assert few.marginal is not None and few.marginal[0].shape[0] == keep.sum() * problem.data.y[0].size


def test_what_a_hypothesis_frees_has_no_column_in_the_last_fit() -> None:
    problem = problem_of({"actuator_lag": {"time_constant": 0.1}})
    every = carrying(problem, {LAG: 0.1}, settings=FitSettings()).tolerances
    fewer = carrying(problem, {LAG: 0.1}, (LAG,), settings=FitSettings()).tolerances
    assert every is not None and fewer is not None
    assert fewer.columns.shape[2] == every.columns.shape[2] - 2  # one for each wheel


def test_a_cause_is_worth_less_where_everything_is_a_little_off() -> None:
    """One per cent of the radii is a cause on a robot that is perfect otherwise, and none beside other differences."""

    def worth(faults: dict[str, dict[str, float]]) -> float:
        problem = problem_of(faults)
        fit = fit_all(problem, [{RADIUS: 1.01}])[0]
        fair = tolerant(carrying(problem, fit.values, settings=FitSettings()), fit, settings=FitSettings())
        before, after = fit_all(fair, [{}, fit.values])
        return before.cost - after.cost

    assert worth({"wheel_radius": {"scale": 1.01}}) > 10.0 * max(worth(LITTLE), 0.0)


@pytest.mark.parametrize("level", LEVELS[2:])
def test_the_level_is_found(level: float) -> None:
    rng = np.random.default_rng(0)
    a = rng.standard_normal((2000, 30))
    r = a @ (level * rng.standard_normal(30)) + rng.standard_normal(2000)
    found = likeliest_level(a.T @ a, a.T @ r, 1.0, settings=PredictSettings())
    assert abs(LEVELS.index(found) - LEVELS.index(level)) <= 1


def test_a_share_of_the_windows_has_to_show_a_share_of_the_evidence() -> None:
    """A fifth of 2000 samples often does not show small differences clearly enough by itself; none are seen where there
    are none."""
    missed = found = false = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        a = rng.standard_normal((2000, 30))
        noise = rng.standard_normal(2000)
        r = a @ (0.06 * rng.standard_normal(30)) + noise
        few, some = a[:400], r[:400]
        settings = PredictSettings()
        missed += likeliest_level(few.T @ few, few.T @ some, 1.0, settings) == 0.0
        found += likeliest_level(few.T @ few, few.T @ some, 1.0, settings, share=0.2) > 0.0
        false += likeliest_level(few.T @ few, few.T @ noise[:400], 1.0, settings, share=0.2) > 0.0
    assert false == 0 and missed >= 5 and found >= 15


def test_columns_about_nearly_the_same_numbers_are_taken_over() -> None:
    """They are derivatives; those about other numbers, or of another set, are measured."""
    problem = problem_of(LITTLE)

    def columns(lag: float) -> np.ndarray:
        found = carrying(problem, {LAG: lag}, settings=FitSettings()).tolerances
        assert found is not None
        return found.columns

    step = problem.space.scale(LAG)
    first = columns(0.1)
    assert columns(0.1 + 0.09 * step) is first
    assert columns(0.1 + 3.0 * step) is not first
    assert columns(0.1) is not first  # the latest alone are kept
    assert carrying(problem, {RADIUS: 1.02}, settings=FitSettings()).tolerances is not None
    fresh = carrying(problem_of(LITTLE), {LAG: 0.1 + 0.09 * step}, settings=FitSettings()).tolerances
    assert fresh is not None
    apart = np.linalg.norm(fresh.columns - first) / np.linalg.norm(fresh.columns)
    assert 0.0 < apart < 0.05


@pytest.mark.parametrize(
    ("limit", "some"), [({}, False), ({"marginal_cost": 1}, True), ({"marginal_columns": 60_000}, True)]
)
def test_where_columns_cost_too_much_some_windows_tell_as_much(limit: dict[str, int], some: bool) -> None:
    """The shift and the added variance are those of all windows, to the accuracy of a smaller sample."""
    problem = problem_of({**LITTLE, "actuator_lag": {"time_constant": 0.15}})
    final = fit_all(problem, [{LAG: 0.1}])[0]
    options = Options(phases=PhaseSettings(**limit))
    found, _ = _with_small_differences(problem, measure_scales(problem.data), final, options)
    assert found is not None and (found.part.data.count < problem.data.count) == some
    assert (found.plain is final) == (not some) == (found.part is problem)
    assert found.problem.data is found.part.data
    assert abs(found.fit.values[LAG] - found.plain.values[LAG]) < 0.02
    assert found.fit.values[LAG] == pytest.approx(0.15, abs=0.02)
