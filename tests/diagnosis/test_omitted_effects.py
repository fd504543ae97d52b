"""How far the numbers of a fit move beside one more small effect."""

from __future__ import annotations

import pytest
from oracles.rover_log import SIGMA, rover_run

from plants.diff_drive import DiffDrive
from residual_mpc.diagnosis.data.dataset import build_dataset
from residual_mpc.diagnosis.fit.least_squares import Fit, fit_all
from residual_mpc.diagnosis.fit.marginalisation import carrying
from residual_mpc.diagnosis.fit.omitted_effects import _directions, _reach, shifts_beside
from residual_mpc.diagnosis.fit.settings import FitSettings, OmittedSettings
from residual_mpc.diagnosis.predict.problem import Problem, build_problem
from residual_mpc.diagnosis.predict.space import build_space
from residual_mpc.diagnosis.predict.tolerances import small_differences
from residual_mpc.models.settings import Knob, Term, Values

ROVER = DiffDrive("rover", 0.033, 0.16)
DELAY = Knob("command_delay", None, "delay")
LAG = Knob("actuator_lag", None, "time_constant")
SETTINGS = FitSettings()


def fitted(faults: dict[str, dict[str, float]], start: Values) -> tuple[Problem, Fit]:
    runs = [rover_run(f"r{k}", faults, seed=k) for k in range(3)]
    data = build_dataset(runs, [ROVER] * 3, SIGMA)
    problem = build_problem(data, build_space(data, ()), data.sigma)
    return problem, fit_all(problem, [start], 12, settings=SETTINGS)[0]


def shifts(problem: Problem, fit: Fit, settings: FitSettings = SETTINGS) -> tuple[Values, ...]:
    differences = small_differences(problem.space, fit.values, fit.knobs, settings=settings.predict)
    carried = carrying(problem, fit.values, fit.knobs, settings=settings)
    return shifts_beside(carried, fit, differences, 4, settings=settings)


def test_a_dead_time_without_the_lag_of_the_robot_is_seen_to_be_too_long() -> None:
    """A dead time of 60 ms and a lag of 25 ms, fitted by a dead time alone."""
    problem, fit = fitted({"command_delay": {"delay": 0.06}, "actuator_lag": {"time_constant": 0.025}}, {DELAY: 0.05})
    assert fit.values[DELAY] > 0.075
    ends = [fit.values[DELAY] + shift[DELAY] for shift in shifts(problem, fit)]
    assert min(ends) == pytest.approx(0.06, abs=0.005)


def test_nothing_moves_where_nothing_is_omitted() -> None:
    problem, fit = fitted({"command_delay": {"delay": 0.06}}, {DELAY: 0.05})
    assert fit.values[DELAY] == pytest.approx(0.06, abs=0.003)
    assert shifts(problem, fit) == ()


def test_the_numbers_move_beside_as_many_effects_as_are_fitted() -> None:
    problem, fit = fitted({"command_delay": {"delay": 0.06}, "actuator_lag": {"time_constant": 0.025}}, {DELAY: 0.05})
    assert len(shifts(problem, fit, FitSettings(omitted=OmittedSettings(most=1)))) == 1


def test_two_wheels_are_one_direction_more_unless_the_set_has_their_effect() -> None:
    problem, fit = fitted({}, {DELAY: 0.0})
    differences = small_differences(problem.space, fit.values, fit.knobs, settings=SETTINGS.predict)
    terms = [d.difference.knob.term for d in _directions(problem.space, fit, differences)]
    assert {Term("actuator_lag", t) for t in (None, "left", "right")} <= set(terms)
    assert all(t.effect != "command_delay" for t in terms)


def test_a_difference_stays_inside_the_bounds_of_its_number() -> None:
    """No wheel has a negative lag; a gain may be smaller or larger."""
    problem, fit = fitted({}, {DELAY: 0.0})
    differences = small_differences(problem.space, fit.values, fit.knobs, settings=SETTINGS.predict)
    reach = {d.knob.effect: _reach(problem.space, d) for d in differences}
    assert reach["actuator_lag"][0] == 0.0 and reach["actuator_lag"][1] == pytest.approx(3.0 / 0.02)
    assert reach["actuator_gain"][0] < -50.0 and reach["actuator_gain"][1] > 100.0
