"""The account extended on both sets of runs."""

import numpy as np
import pytest
from oracles.rover_log import SIGMA, rover_run

from plants.diff_drive import DiffDrive
from residual_mpc.comparison.common_effects import with_common_effects
from residual_mpc.comparison.sets import cut, units_of
from residual_mpc.comparison.settings import ComparisonSettings
from residual_mpc.comparison.space import change_space
from residual_mpc.comparison.units import Units, build_units
from residual_mpc.diagnosis.predict.candidates import build_space
from residual_mpc.diagnosis.predict.problem import Problem, build_problem
from residual_mpc.models.settings import Knob, Values

ROVER = DiffDrive("rover", 0.033, 0.16)
SETTINGS = ComparisonSettings()
DELAY, TRACK = Knob("command_delay", None, "delay"), Knob("track_width", None, "scale")


@pytest.fixture(scope="module")
def late() -> tuple[Problem, Units]:
    """Three runs of a rover before and after, whose commands are 80 ms late in all."""
    runs = [rover_run(f"{k}", {"command_delay": {"delay": 0.08}}, 8.0, seed=k) for k in range(6)]
    two = cut(runs[:3], runs[3:], [ROVER] * 6, SIGMA, 1.0, SETTINGS.results.data)
    space = change_space(build_space(two.clean, (), ("command_delay", "wheel_radius", "track_width")))
    problem = build_problem(two.clean, space, two.clean.sigma, two.scales.motion)
    number = units_of(two.clean, two.later, SETTINGS.contrast)
    return problem, build_units(number, two.side(two.clean), two.clean.run, np.zeros((two.clean.count, 1)))


def test_an_error_that_the_account_lacks_is_added_and_a_needless_one_goes(
    late: tuple[Problem, Units],
) -> None:
    problem, units = late
    found = with_common_effects(problem, {TRACK: 1.02}, units, SETTINGS)
    assert set(found) == {DELAY} and found[DELAY] == pytest.approx(0.08, abs=0.003)


def test_an_account_to_which_nothing_is_to_be_added_stays_as_it_is(late: tuple[Problem, Units]) -> None:
    problem, units = late
    account: Values = {DELAY: 0.08}
    assert with_common_effects(problem, account, units, SETTINGS) is account


def test_changes_stay_beside_what_is_added(late: tuple[Problem, Units]) -> None:
    problem, units = late
    radius = Knob("wheel_radius", None, "scale", True)
    found = with_common_effects(problem, {TRACK: 1.02, radius: 0.99}, units, SETTINGS)
    assert set(found) == {DELAY, radius} and found[radius] == pytest.approx(1.0, abs=0.01)
