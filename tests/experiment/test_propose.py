"""A diagnosis plans at once only what costs next to nothing."""

from types import SimpleNamespace

import pytest

from residual_mpc.experiment import propose as module
from residual_mpc.experiment.sensors import sensors_for
from residual_mpc.models.protocol import State

OPEN = {"next_experiment": {"parts": ["payload", "armature"], "what": "swing it", "commands": None}, "remainder": None}


class Planned(Exception):
    """The planner was called."""


@pytest.mark.parametrize(
    ("joints", "step", "at_once"), [(1, None, True), (1, 0.001, False), (2, None, False), (6, 0.002, False)]
)
def test_arms_of_more_than_one_joint_and_physics_engines_are_left_to_excite(joints, step, at_once, monkeypatch):
    def plan(*_, **__):
        raise Planned

    monkeypatch.setattr(module, "plan_next", plan)
    states = tuple(State(f"position.j{k}", f"velocity.j{k}") for k in range(joints))
    robot = SimpleNamespace(actuators=("j0",), states=states, step=step)
    if at_once:
        with pytest.raises(Planned):
            module.propose(OPEN, robot, "residual-mpc excite", 0)
    else:
        made = module.propose(OPEN, robot, "residual-mpc excite", 0)
        assert made.table is None and made.next_experiment == {
            **OPEN["next_experiment"],
            "sensors": [],
            "excite": "residual-mpc excite",
        }


def depends(kind, form=None, of=None):
    return {"depends_on": [{"kind": kind, "form": form, "of": of}]}


HOT = ("temperature.j0", "temperature.j1", "supply_voltage")


@pytest.mark.parametrize(
    ("remainder", "logged", "wanted"),
    [
        (depends("time", "speed"), (), HOT),
        (depends("work", "added"), ("temperature.j0", "temperature.j1"), ("supply_voltage",)),
        (depends("time", "added"), (), ()),  # at the same time of every run: nothing that warms up
        (depends("wheel_angle", "speed", "left"), (), ("velocity.left",)),
        (depends("wheel_angle", "speed", "left"), ("velocity.left",), ()),
        (depends("heading"), (), ("imu.roll", "imu.pitch")),
        (depends("command_rate"), (), ()),
        ({"depends_on": []}, (), ()),
        (None, (), ()),
    ],
)
def test_a_gap_that_nothing_explains_asks_for_the_sensor_that_would_show_why(remainder, logged, wanted):
    assert sensors_for(remainder, ("j0", "j1"), logged) == wanted


def test_the_sensor_stands_in_the_proposal():
    states = tuple(State(f"position.j{k}", f"velocity.j{k}") for k in range(2))
    robot = SimpleNamespace(actuators=("j0", "j1"), states=states, step=None)
    said = {"parts": [], "what": "drive it twice", "commands": None}
    made = module.propose({"next_experiment": said, "remainder": depends("work")}, robot, "residual-mpc excite", 0)
    assert made.next_experiment["sensors"] == list(HOT)
    assert made.next_experiment["what"] == f"drive it twice; also log {' and '.join(HOT)}"
