"""The account gone on with both sets of runs."""

from collections.abc import Sequence

import numpy as np
import pytest
from oracles.rover_log import SIGMA, rover_run

from plants.diff_drive import DiffDrive
from residual_mpc.comparison.common_effects import with_common_effects
from residual_mpc.comparison.sets import cut, units_of
from residual_mpc.comparison.settings import ComparisonSettings
from residual_mpc.comparison.space import change_space
from residual_mpc.comparison.units import Units, build_units
from residual_mpc.diagnosis.predict.problem import Problem, build_problem
from residual_mpc.diagnosis.predict.space import build_space
from residual_mpc.models.settings import Knob, Values

ROVER = DiffDrive("rover", 0.033, 0.16)
SETTINGS = ComparisonSettings()
DELAY, RADIUS, TRACK = (
    Knob("command_delay", None, "delay"),
    Knob("wheel_radius", None, "scale"),
    Knob("track_width", None, "scale"),
)


def sets_of(before: float, after: float, effects: Sequence[str]) -> tuple[Problem, Units]:
    """Three runs each of a rover whose commands are so late, s."""
    runs = [[rover_run(f"{i}{k}", {"command_delay": {"delay": delay}}, 8.0, seed=10 * i + k) for k in range(3)]
            for i, delay in enumerate((before, after))]  # fmt: skip
    two = cut(runs[0], runs[1], [ROVER] * 6, SIGMA, 1.0, SETTINGS.results.data)
    space = change_space(build_space(two.clean, (), tuple(effects)))
    problem = build_problem(two.clean, space, two.clean.sigma, two.scales.motion)
    number = units_of(two.clean, two.later, SETTINGS.contrast)
    return problem, build_units(number, two.side(two.clean), two.clean.run, np.zeros((two.clean.count, 1)))


def test_an_error_of_the_model_that_the_account_lacks_is_added_and_a_needless_one_goes() -> None:
    problem, units = sets_of(0.08, 0.08, ("command_delay", "wheel_radius", "track_width"))
    found = with_common_effects(problem, {TRACK: 1.02}, units, SETTINGS)
    assert set(found) == {DELAY} and found[DELAY] == pytest.approx(0.08, abs=0.003)


def test_an_account_to_which_nothing_is_to_be_added_stays_as_it_is() -> None:
    problem, units = sets_of(0.08, 0.08, ("command_delay", "wheel_radius", "track_width"))
    account: Values = {DELAY: 0.08}
    assert with_common_effects(problem, account, units, SETTINGS) is account


def test_a_change_stays_beside_the_account() -> None:
    """The effect that changes may be on both sets as well."""
    problem, units = sets_of(0.05, 0.12, ("command_delay", "wheel_radius"))
    changed = DELAY._replace(changed=True)
    found = with_common_effects(problem, {changed: 0.10}, units, SETTINGS)
    assert set(found) == {DELAY, changed}
    assert found[DELAY] == pytest.approx(0.05, abs=0.004) and found[changed] == pytest.approx(0.07, abs=0.005)
