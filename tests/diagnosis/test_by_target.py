"""What acts on all targets alike is told apart by target."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from oracles.rover_log import SIGMA, rover_run

from plants.diff_drive import DiffDrive
from residual_mpc.diagnosis.data.dataset import build_dataset
from residual_mpc.diagnosis.data.gap import measure_scales
from residual_mpc.diagnosis.fit.evidence import blocks_of
from residual_mpc.diagnosis.fit.least_squares import Fit, fit_all
from residual_mpc.diagnosis.fit.settings import FitSettings
from residual_mpc.diagnosis.predict.candidates import build_space
from residual_mpc.diagnosis.predict.problem import Problem, build_problem
from residual_mpc.diagnosis.search import by_target as module
from residual_mpc.diagnosis.search import stepwise
from residual_mpc.diagnosis.search.by_target import by_target, counted
from residual_mpc.diagnosis.search.settings import PairSettings, SearchSettings
from residual_mpc.diagnosis.search.stepwise import stepwise_search
from residual_mpc.logs.run import Run
from residual_mpc.models.settings import Knob, Term, Values

ROVER = DiffDrive("rover", 0.033, 0.16)
BOTH, LEFT, RIGHT = (Knob("actuator_gain", target, "gain") for target in (None, "left", "right"))


def problem_of(left: float) -> Problem:
    """Runs of a rover whose right wheel has a gain of 0.9, and the left one another one."""
    runs = []
    for seed in range(2):
        run = rover_run(f"r{seed}", {"actuator_gain": {"gain": 0.9}}, seed=seed)
        runs.append(Run(run.name, run.t, {**run.columns, "command.left": run.columns["command.left"] * 0.9 / left}))
    data = build_dataset(runs, [ROVER] * 2, SIGMA)
    return build_problem(data, build_space(data, (), ("actuator_gain",)), data.sigma, measure_scales(data).motion)


def split(problem: Problem) -> list[Fit]:
    (alike,) = fit_all(problem, [{BOTH: 0.85}])
    return by_target(problem, alike, blocks_of(problem.data, settings=FitSettings()), SearchSettings())


def test_two_gains_are_found_from_their_middle() -> None:
    (fit,) = split(problem_of(0.8))
    assert fit.values[LEFT] == pytest.approx(0.8, abs=0.003) and fit.values[RIGHT] == pytest.approx(0.9, abs=0.003)
    assert BOTH not in fit.values


def test_a_linear_step_that_leads_away_is_not_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_linear_step", lambda *of: ({LEFT: 0.2, RIGHT: 4.0}, 1e9))
    begun: list[Values] = []

    def fits(problem: Problem, starts: Sequence[Values], *args: Any, **settings: Any) -> list[Fit]:
        begun.extend(starts)
        return fit_all(problem, starts, *args, **settings)

    monkeypatch.setattr(module, "fit_all", fits)
    split(problem_of(0.8))
    (start,) = begun
    assert start[LEFT] == start[RIGHT] == pytest.approx(0.85, abs=0.01)


def test_nothing_is_fitted_where_all_are_alike() -> None:
    assert split(problem_of(0.9)) == []


def test_a_search_ends_with_one_number_for_each() -> None:
    problem = problem_of(0.8)
    scales = measure_scales(problem.data)
    found = stepwise_search(problem, scales, SearchSettings(), np.random.default_rng(0))
    assert set(found.fit.terms) == {LEFT.term, RIGHT.term}


def test_one_effect_on_many_targets_counts_as_two_or_as_half_of_them() -> None:
    joints = [Term("coulomb_friction", f"j{k}") for k in range(6)]
    assert counted(joints[:3]) == 2 and counted([*joints[:3], Term("payload", None)]) == 3
    assert counted(joints) == 3 and counted([*joints, Term("payload", None)]) == 4
    assert counted([Term("coulomb_friction", "j1"), Term("payload", None)]) == 2 and counted([]) == 0


def test_telling_apart_comes_before_an_addition_that_leaves_far_more(monkeypatch: pytest.MonkeyPatch) -> None:
    """A drift is there too, and convincing on its own; no wheel is offered a number of its own as an addition. Without
    pairs, of which the gain and the drift would be one."""
    runs = []
    for seed in range(2):
        run = rover_run(
            f"r{seed}", {"actuator_gain": {"gain": 0.9}, "slope": {"rate": 0.0075, "heading": 0.5}}, seed=seed
        )
        runs.append(Run(run.name, run.t, {**run.columns, "command.left": run.columns["command.left"] * 0.9 / 0.7}))
    data = build_dataset(runs, [ROVER] * 2, SIGMA)
    scales = measure_scales(data)
    problem = build_problem(data, build_space(data, (), ("actuator_gain", "slope")), data.sigma, scales.motion)
    alike = stepwise.additions
    monkeypatch.setattr(
        stepwise, "additions", lambda *of: [f for f in alike(*of) if not {LEFT.term, RIGHT.term} & set(f.terms)]
    )
    settings = SearchSettings(pairs=PairSettings(sought=False))
    found = stepwise_search(problem, scales, settings, np.random.default_rng(0))
    both = [set(step.terms) for step in found.steps]
    assert both[0] == {BOTH.term} and both[1] == {LEFT.term, RIGHT.term}
