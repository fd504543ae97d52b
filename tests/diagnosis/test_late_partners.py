"""A dead time and a lag that a search has taken for one of them."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from oracles.rover_log import SIGMA, rover_run

from plants.diff_drive import DiffDrive
from residual_mpc.diagnosis.data.dataset import build_dataset
from residual_mpc.diagnosis.data.gap import measure_scales
from residual_mpc.diagnosis.fit.least_squares import fit_all
from residual_mpc.diagnosis.predict.candidates import build_space
from residual_mpc.diagnosis.predict.problem import build_problem
from residual_mpc.diagnosis.search.late_partners import with_partner
from residual_mpc.diagnosis.search.settings import SearchSettings
from residual_mpc.models.settings import Knob, Values

ROVER = DiffDrive("rover", 0.033, 0.16)
DELAY, LAG = Knob("command_delay", None, "delay"), Knob("actuator_lag", None, "time_constant")


def found(
    faults: dict[str, dict[str, float]], named: Values, gaps: tuple[float, float] = (0.01, 0.01)
) -> Values | None:
    """gaps: squared ones before and after, at a squared floor of 0.01."""
    runs = [rover_run(f"r{seed}", faults, 12.0, seed=seed) for seed in range(2)]
    data = build_dataset(runs, [ROVER] * 2, SIGMA)
    space = build_space(data, (), ("command_delay", "actuator_lag"))
    problem = build_problem(data, space, data.sigma, measure_scales(data).motion)
    (fit,) = fit_all(problem, [named])
    ruler: Any = SimpleNamespace(squared=lambda fits: np.array(gaps), floor=0.01)
    both = with_partner(problem, ruler, fit, SearchSettings())
    return None if both is None else both.values


BOTH = {"command_delay": {"delay": 0.08}, "actuator_lag": {"time_constant": 0.12}}


@pytest.mark.parametrize("named", [{DELAY: 0.18}, {LAG: 0.2}])
def test_the_other_is_added(named: Values) -> None:
    values = found(BOTH, named)
    assert values is not None
    assert values[DELAY] == pytest.approx(0.08, abs=0.01) and values[LAG] == pytest.approx(0.12, abs=0.015)


@pytest.mark.parametrize(
    ("faults", "named"),
    [({"command_delay": BOTH["command_delay"]}, {DELAY: 0.08}), ({"actuator_lag": BOTH["actuator_lag"]}, {LAG: 0.12})],
)
def test_nothing_is_added_to_one_that_is_alone(faults: dict[str, dict[str, float]], named: Values) -> None:
    assert found(faults, named) is None


def test_a_visibly_larger_gap_speaks_against_both() -> None:
    assert found(BOTH, {DELAY: 0.18}, (0.01, 0.02)) is None
    assert found(BOTH, {DELAY: 0.08, LAG: 0.12}) is None  # both are named
