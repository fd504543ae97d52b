"""The last fits: from more than one start, within what is physically possible, with intervals that are never empty."""

from __future__ import annotations

import numpy as np
import pytest
from oracles.rover_log import SIGMA, rover_run

from plants.diff_drive import DiffDrive
from residual_mpc.diagnosis.data.constant_velocity import constant_velocity
from residual_mpc.diagnosis.data.dataset import build_dataset
from residual_mpc.diagnosis.data.gap import fit_trust, gap_of, measure_scales, window_trust
from residual_mpc.diagnosis.data.settings import DataSettings
from residual_mpc.diagnosis.fit.least_squares import fit_all
from residual_mpc.diagnosis.fit.polish import polish
from residual_mpc.diagnosis.fit.settings import FitSettings
from residual_mpc.diagnosis.fit.start_values import elsewhere, possible
from residual_mpc.diagnosis.predict.candidates import build_space
from residual_mpc.diagnosis.predict.problem import Problem, build_problem
from residual_mpc.diagnosis.results.intervals import sigmas
from residual_mpc.diagnosis.results.settings import ResultSettings
from residual_mpc.logs.run import Run
from residual_mpc.models.settings import Knob, Values

ROVER = DiffDrive("rover", 0.033, 0.16)
LAG = Knob("actuator_lag", None, "time_constant")
TRACK = Knob("track_width", None, "scale")


def problem_of(faults: dict[str, dict[str, float]]) -> Problem:
    runs = [rover_run(f"r{k}", faults, seed=k) for k in range(2)]
    data = build_dataset(runs, [ROVER] * 2, SIGMA)
    return build_problem(data, build_space(data, ()), data.sigma)


def test_another_start_is_another_place_within_the_bounds() -> None:
    problem = problem_of({})
    start = {LAG: 0.0, TRACK: 1.2}
    other = elsewhere(problem, start, settings=FitSettings())
    assert other is not None
    for knob, value in other.items():
        low, high = problem.space.bounds(knob)
        assert low <= value <= high
        assert value != start[knob]
    assert elsewhere(problem, {}, settings=FitSettings()) is None


def test_a_bad_start_ends_where_the_good_one_does() -> None:
    problem = problem_of({"actuator_lag": {"time_constant": 0.12}, "track_width": {"scale": 1.2}})
    starts: list[Values] = [{LAG: 0.11, TRACK: 1.19}, {LAG: 0.4, TRACK: 1.8}]
    good, bad = polish(problem, starts, 100_000, measure_scales(problem.data), settings=FitSettings())
    assert good.fit.values[TRACK] == pytest.approx(1.2, abs=0.02)
    for knob in (LAG, TRACK):
        assert bad.fit.values[knob] == pytest.approx(good.fit.values[knob], rel=0.02)
        assert min(good.ends[knob]) <= good.fit.values[knob] <= max(good.ends[knob])


def test_a_number_at_its_bound_has_an_interval() -> None:
    problem = problem_of({})
    fit = fit_all(problem, [{LAG: 0.0, TRACK: 1.0}], 4)[0]
    at_bound = fit.knobs.index(LAG)
    if not fit.held[at_bound]:  # noise may just as well let it off the bound
        fit = fit_all(problem, [{LAG: 0.0, TRACK: 1.0}], 0)[0]
    assert (sigmas(problem, fit, settings=ResultSettings()) > 0.0).all()


def test_kinetic_friction_above_static_is_impossible() -> None:
    knobs = [Knob("stribeck_friction", "j1", p) for p in ("static", "kinetic", "velocity")]
    assert possible(dict(zip(knobs, (0.3, 0.2, 0.1), strict=True)))
    assert not possible(dict(zip(knobs, (0.2, 0.3, 0.1), strict=True)))


def test_a_few_windows_that_diverge_count_at_a_limit() -> None:
    runs = [rover_run("r", {}, 40.0)]
    data = build_dataset(runs, [ROVER], SIGMA)
    scales = measure_scales(data)
    error = np.full(data.y.shape, 0.01) * scales.s
    error[:3] = 50.0 * scales.s
    trust = window_trust(data, scales, error, settings=DataSettings())
    assert (trust[3:] == 1.0).all()
    capped = gap_of(data, scales, error, trust).total
    assert capped < 2.0 * DataSettings().trust.diverged < gap_of(data, scales, error).total
    assert (
        window_trust(data, scales, np.full(data.y.shape, 3.0) * scales.s, settings=DataSettings()) == 1.0
    ).all()  # all alike: none is an outlier


def test_a_window_unlike_the_others_counts_at_a_limit_in_fits() -> None:
    runs = [rover_run("r", {}, 40.0)]
    data = build_dataset(runs, [ROVER], SIGMA)
    scales = measure_scales(data)
    error = np.full(data.y.shape, 0.001) * scales.s
    error[: len(error) // 2] *= 3.0  # moving in half of the windows, at rest in the others
    error[0] = 0.2 * scales.s  # far from divergence, and far from the rest
    trust = fit_trust(data, scales, error, settings=DataSettings())
    assert (trust[1:] == 1.0).all()
    assert trust[0] == pytest.approx((DataSettings().trust.unlike * 0.003 / 0.2) ** 2, rel=1e-6)
    assert (window_trust(data, scales, error, settings=DataSettings()) == 1.0).all()


def test_constant_velocity_foretells_constant_velocity() -> None:
    t = np.arange(0.0, 8.0, 0.05)
    columns = {"command.left": np.full(len(t), 3.0), "command.right": np.full(len(t), 4.0), "pose.x": 0.3 * t,
               "pose.y": -0.1 * t, "pose.theta": 0.2 * t}  # fmt: skip
    data = build_dataset([Run("r", t, columns)], [ROVER], SIGMA)
    np.testing.assert_allclose(constant_velocity(data), data.y, atol=1e-9)
