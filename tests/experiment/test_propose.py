"""A diagnosis plans at once only what costs next to nothing."""

from types import SimpleNamespace

import pytest

from residual_mpc.experiment import propose as module
from residual_mpc.models.protocol import State

OPEN = {"next_experiment": {"what": "swing it", "commands": None}}


class Planned(Exception):
    """The planner was called."""


@pytest.mark.parametrize(("joints", "at_once"), [(1, True), (2, False), (3, False), (6, False)])
def test_arms_of_more_than_one_joint_are_left_to_excite(joints, at_once, monkeypatch):
    def plan(*_):
        raise Planned

    monkeypatch.setattr(module, "plan_next", plan)
    robot = SimpleNamespace(states=tuple(State(f"position.j{k}", f"velocity.j{k}") for k in range(joints)))
    if at_once:
        with pytest.raises(Planned):
            module.propose(OPEN, robot, "residual-mpc excite", 0)
    else:
        made = module.propose(OPEN, robot, "residual-mpc excite", 0)
        assert made.table is None and made.next_experiment == {
            **OPEN["next_experiment"],
            "excite": "residual-mpc excite",
        }
