"""What each scenario withholds is named from its practice runs alone, with its size."""

from __future__ import annotations

import pytest

from residual_mpc.closed_loop.scenario import RunOptions, find_scenario
from residual_mpc.models.settings import Knob
from scenarios.closed_loop.training_runs import diagnosed, recorded

NAMES = ("figure_eight", "back_and_forth", "route", "constant_yaw_rate", "spin", "arm_circle_line", "arm_circle_z")
OWN = 0.02  # s, that the engines' own motors take, which no model here has
FRICTION = 0.12  # share: the scaler arm's model has no inertia, which its friction takes up
SIZE = 0.04


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_what_is_withheld_is_named_with_its_size(name: str) -> None:
    task = find_scenario(name).task
    setup, options = task.setup(), RunOptions(seeds=1)
    found = diagnosed(recorded(task, setup, options, lambda stage, done: None), setup, options).diagnosis
    assert found.verdict == "effects"
    sure = {c.term for c in found.causes if c.probability >= 0.9}
    for where, true in task.withheld.items():
        knob = Knob(*where)
        assert knob.term in sure, [(c.term, c.probability) for c in found.causes]
        late = knob.parameter in ("delay", "time_constant")
        most = OWN if late else true * (FRICTION if knob.parameter == "coefficient" else SIZE)
        assert abs(found.values[knob] - true) < most
    assert sure == {Knob(*where).term for where in task.withheld}
