"""A robot whose motors are stronger than its model says."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from oracles.arms import arm_xml, robot_of
from oracles.hidden_laws import ARM, weakening_run
from oracles.rover_log import write_run

import residual_mpc as rm
from residual_mpc.diagnosis.fit import least_limits
from residual_mpc.diagnosis.fit.least_squares import Fit
from residual_mpc.diagnosis.fit.polish import Polished
from residual_mpc.diagnosis.predict.reached_limits import MOST_RAISED, PROBED, reached_limit
from residual_mpc.diagnosis.predict.space import Space
from residual_mpc.effects.library import LIBRARY
from residual_mpc.models.settings import Knob, Term, Values

LIMIT = "saturation"
FEW = (LIMIT, "actuator_gain", "viscous_friction", "joint_spring", "armature", "torque_offset", "command_delay")


def limit_of(folder: Path, model: float, robot: float) -> tuple[float, tuple[float, float]]:
    """The probability and the interval of the limit, which alone is named. model, robot: N m."""
    (folder / "arm.xml").write_text(ARM.replace("-5 5", f"-{model} {model}"))
    (folder / "robot.toml").write_text('name = "arm"\nplant = "mujoco"\nmodel = "arm.xml"\n')
    for seed in range(5):
        write_run(weakening_run(seed, 0.0, 0.0, strongest=robot), folder)
    nominal = rm.load_robot(folder / "robot.toml")
    found = rm.diagnose(nominal, rm.read_runs(nominal, [folder]), only=FEW)
    assert found.verdict == "effects"
    (named,) = found.explanation
    assert named["effect"] == LIMIT
    return named["probability"], tuple(named["parameters"]["limit"]["ci95"])


def test_a_limit_of_the_model_that_is_too_low_is_named(tmp_path: Path) -> None:
    """1.2 N m in the model, 1.8 on the robot, which its arm's weight and motions ask for. Such a robot used to be said
    to have negative friction, springs and another inertia."""
    probability, (low, high) = limit_of(tmp_path, 1.2, 1.8)
    assert probability > 0.8 and 1.7 < low <= 1.8 <= high < 1.9


def test_a_limit_that_the_robot_hardly_reaches_is_known_from_below(tmp_path: Path) -> None:
    probability, (low, high) = limit_of(tmp_path, 2.0, 3.0)
    assert probability > 0.8 and 2.0 < low <= 3.0 and high == 4.0 * 2.0  # as far as it is looked for


@dataclass(frozen=True)
class Flat:
    """A problem whose cost stays the same once the limit exceeds the largest force that the runs need, 3 N m."""

    data: Any
    space: Any

    def cost(self, values: Values) -> float:
        return 5.0 + 400.0 * max(3.0 - values[LIMIT_KNOB], 0.0) ** 2


LIMIT_KNOB = Knob(LIMIT, None, "limit")


def test_a_limit_in_a_flat_part_of_the_cost_is_stated_where_that_begins(monkeypatch: pytest.MonkeyPatch) -> None:
    space = SimpleNamespace(reached_limit=lambda term: 2.0, bounds=lambda knob: (0.0, 8.0))
    flat = Flat(None, space)

    def at(problem: Flat, values: Values, settings: object) -> Fit:
        empty = np.zeros(0)
        return Fit((Term(LIMIT, None),), (LIMIT_KNOB,), values, empty, problem.cost(values), empty, empty, empty)

    monkeypatch.setattr(least_limits, "_at", at)
    monkeypatch.setattr(least_limits, "blocks_of", lambda data, settings: None)
    monkeypatch.setattr(least_limits, "dispersion", lambda fit, blocks: 1.0)
    begun: Any = Polished(at(flat, {LIMIT_KNOB: 7.0}, None), {LIMIT_KNOB: (7.0, 5.0)})
    found = least_limits.with_least_limits(flat, begun, None)  # type: ignore[arg-type]
    value = found.fit.values[LIMIT_KNOB]
    assert 3.0 - 0.02 < value < 3.0 + 0.01 and found.ends[LIMIT_KNOB] == (value, 7.0, 5.0, 8.0)
    below: Any = Polished(at(flat, {LIMIT_KNOB: 1.5}, None), {})
    assert least_limits.with_least_limits(flat, below, None).fit.values == {LIMIT_KNOB: 1.5}  # type: ignore[arg-type]


def test_only_a_limit_that_the_model_reaches_may_be_raised(tmp_path: Path) -> None:
    robot = robot_of(tmp_path, arm_xml())  # j2 gives at most 3 N m, j1 has no limit
    slots = {e.name: robot.slots(e.name) for e in LIBRARY}

    def space(output: float) -> Space:
        return Space(robot, slots, (), (), {("output", "j1"): 9.0, ("output", "j2"): output}, {})

    weak, strong = space(2.0), space(3.0)
    assert [reached_limit(robot, s.references, ("j1", "j2")) for s in (weak, strong)] == [0.0, 3.0]
    knob, term = Knob(LIMIT, "j2", "limit"), Term(LIMIT, "j2")
    assert weak.bounds(knob)[1] == pytest.approx(1.2 * 2.0)
    assert strong.bounds(knob)[1] == pytest.approx(MOST_RAISED * 3.0)
    beyond = [[dose[knob] for dose in s.plausible(term) if dose[knob] > 3.0] for s in (weak, strong)]
    assert beyond == [[], [pytest.approx(x * 3.0) for x in PROBED]]
    assert strong.reached_limit(Term("actuator_gain", "j2")) == 0.0
    assert strong.reached_limit(Term(LIMIT, "j1")) == 0.0
