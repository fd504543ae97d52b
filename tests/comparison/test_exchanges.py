"""Two wrong changes that make up for each other give way to the two right ones."""

from __future__ import annotations

import numpy as np
import pytest
from oracles.rover_log import SIGMA, rover_run

from plants.diff_drive import DiffDrive
from residual_mpc.comparison.contrast import Contrasts
from residual_mpc.comparison.exchanges import exchanged
from residual_mpc.comparison.search import FoundChange, FoundChanges
from residual_mpc.comparison.sets import cut, units_of
from residual_mpc.comparison.settings import ComparisonSettings
from residual_mpc.comparison.space import change_space
from residual_mpc.comparison.units import Units, build_units
from residual_mpc.diagnosis.fit.evidence import dispersion
from residual_mpc.diagnosis.fit.least_squares import fit_all
from residual_mpc.diagnosis.predict.candidates import build_space
from residual_mpc.diagnosis.predict.problem import Problem, build_problem
from residual_mpc.models.settings import Knob, Term, Values

ROVER = DiffDrive("rover", 0.033, 0.16)
DELAY, LAG, TRACK, RADIUS = (
    Knob(*known, True)
    for known in (
        ("command_delay", None, "delay"),
        ("actuator_lag", None, "time_constant"),
        ("track_width", None, "scale"),
        ("wheel_radius", None, "scale"),
    )
)
SETTINGS = ComparisonSettings()


@pytest.fixture(scope="module")
def delayed_and_wider() -> tuple[Problem, Units]:
    """The later set has a delay and a wider track."""
    faults = {"command_delay": {"delay": 0.12}, "track_width": {"scale": 1.15}}
    sets = [[rover_run(f"{name}{k}", effects, 12.0, seed=10 * i + k) for k in range(3)]
            for i, (name, effects) in enumerate((("before", {}), ("after", faults)))]  # fmt: skip
    two = cut(sets[0], sets[1], [ROVER] * 6, SIGMA, 1.0, SETTINGS.results.data)
    data = two.clean
    space = change_space(build_space(data, (), tuple(k.effect for k in (DELAY, LAG, TRACK, RADIUS))))
    problem = build_problem(data, space, data.sigma, two.scales.motion)
    number = units_of(data, two.later, SETTINGS.contrast)
    return problem, build_units(number, two.side(data), data.run, np.zeros((data.count, 1)))


def found(of: tuple[Problem, Units], values: Values) -> FoundChanges:
    """These changes, fitted."""
    problem, units = of
    account, fit = fit_all(problem, [{}, values], settings=SETTINGS.results.fit)
    changes = tuple(FoundChange(k.term, p, p, False) for k, p in zip(values, (0.001, 0.01), strict=False))
    return FoundChanges(fit, account, changes, Contrasts((), 1.0), dispersion(fit, units.number))


def swapped(of: tuple[Problem, Units], changes: FoundChanges) -> FoundChanges:
    problem, units = of
    return exchanged(problem, changes, units, SETTINGS)


def terms(changes: FoundChanges) -> set[Term]:
    return {c.term for c in changes.changes}


def test_two_wrong_changes_give_way_to_the_right_ones(delayed_and_wider: tuple[Problem, Units]) -> None:
    wrong = found(delayed_and_wider, {LAG: 0.1, RADIUS: 0.9})
    right = swapped(delayed_and_wider, wrong)
    assert terms(right) == {DELAY.term, TRACK.term} and right.fit.cost < 0.2 * wrong.fit.cost
    assert right.fit.values[DELAY] == pytest.approx(0.12, abs=0.01)
    assert right.fit.values[TRACK] == pytest.approx(1.15, abs=0.01)
    assert {c.p for c in right.changes} == {0.01}  # as significant as the less significant of those they stand for


def test_right_changes_stay(delayed_and_wider: tuple[Problem, Units]) -> None:
    right = found(delayed_and_wider, {DELAY: 0.12, TRACK: 1.15})
    assert swapped(delayed_and_wider, right) is right


def test_a_single_change_is_not_exchanged(delayed_and_wider: tuple[Problem, Units]) -> None:
    alone = found(delayed_and_wider, {LAG: 0.1})
    assert swapped(delayed_and_wider, alone) is alone
