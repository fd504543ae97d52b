"""How far the numbers of a fit move beside one more small effect."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from oracles.arms import arm_xml, robot_of
from oracles.rover_log import SIGMA, rover_run

from plants.diff_drive import DiffDrive
from residual_mpc.diagnosis.data.dataset import build_dataset
from residual_mpc.diagnosis.fit.least_squares import Fit, fit_all
from residual_mpc.diagnosis.fit.marginalisation import carrying
from residual_mpc.diagnosis.fit.omitted_effects import _directions, _reach, shifts_beside
from residual_mpc.diagnosis.fit.settings import FitSettings, OmittedSettings
from residual_mpc.diagnosis.predict.candidates import build_space
from residual_mpc.diagnosis.predict.problem import Problem, build_problem
from residual_mpc.diagnosis.predict.space import Space
from residual_mpc.diagnosis.predict.tolerances import small_differences
from residual_mpc.effects.library import LIBRARY
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


def test_at_most_so_many_effects_are_fitted_beside() -> None:
    problem, fit = fitted({"command_delay": {"delay": 0.06}, "actuator_lag": {"time_constant": 0.025}}, {DELAY: 0.05})
    assert len(shifts(problem, fit)) > 1
    assert len(shifts(problem, fit, FitSettings(omitted=OmittedSettings(most=1)))) == 1


def terms_beside(start: Values, twins: tuple[frozenset[Term], ...] = ()) -> set[Term]:
    """The effects that may be fitted beside a set."""
    problem, fit = fitted({}, start)
    space = replace(problem.space, twins=twins)
    differences = small_differences(space, fit.values, fit.knobs, settings=SETTINGS.predict)
    return {d.difference.knob.term for d in _directions(space, fit, differences)}


def test_both_wheels_alike_are_one_more_unless_the_set_has_the_effect_or_its_twin() -> None:
    """A dead time of the commands and a delay of all readings are twins."""
    wheels = (None, "left", "right")
    beside = terms_beside({Knob("actuator_gain", "left", "gain"): 1.0})
    assert {Term("actuator_lag", t) for t in wheels} <= beside
    assert {t for t in beside if t.effect == "actuator_gain"} == {Term("actuator_gain", "right")}
    late, seen = Term("command_delay", None), Knob("sensor_delay", "pose", "delay")
    assert late in terms_beside({seen: 0.01})
    assert late not in terms_beside({seen: 0.01}, (frozenset({late, seen.term}),))


def test_all_alike_counts_each_target_by_its_own_step(tmp_path: Path) -> None:
    """One tolerance of dry friction is a share of each joint's torque; the same friction at both is not the sum."""
    robot = robot_of(tmp_path, arm_xml())
    references = {("torque", "j1"): 3.0, ("torque", "j2"): 0.3}
    terms = tuple(Term("coulomb_friction", j) for j in (None, "j1", "j2"))
    space = Space(robot, {e.name: robot.slots(e.name) for e in LIBRARY}, terms, (), references, {})
    differences = small_differences(space, {}, settings=SETTINGS.predict)
    fit: Any = SimpleNamespace(terms=(), values={})
    (both,) = (d for d in _directions(space, fit, differences) if d.difference.knob.target is None)
    steps = [differences[i].step for i in both.columns]
    assert steps[0] == pytest.approx(10.0 * steps[1])
    np.testing.assert_allclose(np.array(both.weights) * steps, both.difference.step)


def test_a_difference_stays_inside_the_bounds_of_its_number() -> None:
    """No wheel has a negative lag; a gain may be smaller or larger."""
    problem, fit = fitted({}, {DELAY: 0.0})
    differences = small_differences(problem.space, fit.values, fit.knobs, settings=SETTINGS.predict)
    reach = {d.knob.effect: _reach(problem.space, d) for d in differences}
    assert reach["actuator_lag"][0] == 0.0 and reach["actuator_lag"][1] == pytest.approx(3.0 / 0.02)
    assert reach["actuator_gain"][0] < -50.0 and reach["actuator_gain"][1] > 100.0
