"""Laws beside effects with names: what is simple enough gets its name, and a law takes up what it contains."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from oracles.arms import arm_xml, robot_of

from residual_mpc.diagnosis.laws import add, figures
from residual_mpc.diagnosis.laws.named import named_twin, replaced, taken_up
from residual_mpc.diagnosis.laws.propose import Proposal, proposal
from residual_mpc.diagnosis.laws.settings import LawSettings
from residual_mpc.diagnosis.laws.shapes import Shape, richer
from residual_mpc.diagnosis.phases.laws import _still_standing
from residual_mpc.diagnosis.predict.space import Space
from residual_mpc.diagnosis.search.rivals import Rivalry
from residual_mpc.effects.laws import KINDS, LawKind, curve_shape
from residual_mpc.effects.library import HOSTED
from residual_mpc.models import optional
from residual_mpc.models.settings import Knob, Term

OFFSET = Term("torque_offset", "j1")


def kind_of(of: str, on: str) -> LawKind:
    return next(k for k in KINDS if (k.of, k.on, k.shape) == (of, on, "curve"))


@pytest.fixture
def space(tmp_path: Path) -> Space:
    robot = robot_of(tmp_path, arm_xml())
    candidates = tuple(Term(e, j) for e in ("coulomb_friction", "torque_offset", "joint_spring") for j in robot.joints)
    return Space(robot, {e.name: robot.slots(e.name) for e in HOSTED}, candidates, (), {}, {})


def law(of: str, on: str, form: str, knots: tuple[float, ...] = (0.0,), target: str = "j2") -> Proposal:
    free = ("start", *(f"rise{i}" for i in range(2, len(knots) + 1)))
    return proposal(kind_of(of, on), target, Shape(form, curve_shape(knots), free))


@pytest.mark.parametrize(
    ("of", "on", "form", "name"),
    [
        ("friction", "time", "constant", "coulomb_friction"),
        ("friction", "position", "constant", "coulomb_friction"),
        ("torque", "speed", "constant", "torque_offset"),
        ("torque", "position", "line", "joint_spring"),
        ("torque", "time", "line", None),
        ("friction", "position", "line", None),
        ("strength", "load", "constant", None),
        ("torque", "speed", "line", "viscous_friction"),
    ],
)
def test_a_simple_law_is_an_effect_with_a_name(space: Space, of: str, on: str, form: str, name: str | None) -> None:
    """Of its own joint, and only where the name is a candidate: viscous friction is not among these."""
    given = law(of, on, form, (0.0, 1.0) if form == "line" else (0.0,))
    found = named_twin(given, space)
    if name is None or name == "viscous_friction":
        assert found is None
    else:
        assert found is not None and found.term == Term(name, "j2") and found.start and not found.fixed


def test_a_constant_share_of_the_load_is_the_gain_of_a_joints_only_actuator(space: Space) -> None:
    at = optional.actuator_joints(space.robot).index("j2")
    gain = Term("actuator_gain", space.robot.actuators[at])
    found = named_twin(law("strength", "position", "constant"), replace(space, candidates=(gain,)))
    assert found is not None and found.term == gain
    in_proportion = named_twin(law("torque", "command", "line", (0.0, 1.0)), replace(space, candidates=(gain,)))
    assert in_proportion is not None and in_proportion.term == gain
    assert named_twin(law("torque", "command", "bend", (0.0, 1.0, 2.0)), replace(space, candidates=(gain,))) is None
    both = SimpleNamespace(actuators=("p", "d"), actuator_joints=("j2", "j2"), slots=lambda effect: ("p", "d"))
    alone: Any = replace(space, robot=both, candidates=(Term("actuator_gain", "p"),))  # type: ignore[arg-type]
    assert named_twin(law("strength", "position", "constant"), alone) is None


def test_a_law_takes_up_the_effect_that_is_its_level(space: Space) -> None:
    of = law("torque", "position", "line", (-1.0, 1.0), "j1")
    start, rise = (Knob(of.term.effect, "j1", n) for n in ("start", "rise2"))
    values = {Knob("torque_offset", "j1", "torque"): 0.3, start: -0.1, rise: 0.5}
    assert taken_up(values, OFFSET, space) == {start: pytest.approx(0.2), rise: 0.5}
    elsewhere = {Knob("torque_offset", "j2", "torque"): 0.3, start: -0.1, rise: 0.5}
    assert taken_up(elsewhere, Term("torque_offset", "j2"), space) == {start: -0.1, rise: 0.5}


def test_effects_that_a_law_replaced_come_back_with_their_numbers() -> None:
    before = {Knob("torque_offset", "j1", "torque"): 0.3, Knob("coulomb_friction", None, "torque"): 0.1}
    now = {Knob("coulomb_friction", None, "torque"): 0.2}
    (back,) = replaced(before, now)
    assert back.term == OFFSET and back.start == {Knob("torque_offset", "j1", "torque"): 0.3}


def test_richer_shapes_span_the_quantity() -> None:
    z, settings = np.linspace(-1.0, 3.0, 400), LawSettings()
    line = Shape("line", curve_shape([-1.0, 3.0]), ("start", "rise2"))
    bend, curve = richer(kind_of("torque", "position"), line, z, settings)
    assert (bend.form, curve.form) == ("bend", "curve")
    assert bend.fixed["knot2"] == pytest.approx(1.0) and len(curve.free) == settings.knots
    assert richer(kind_of("torque", "position"), curve, z, settings) == ()
    constant = replace(line, form="constant", free=("start",))
    assert richer(kind_of("torque", "position"), constant, z, settings) == ()  # an offset, which has a name
    assert [s.form for s in richer(kind_of("strength", "load"), constant, z, settings)] == ["bend", "curve"]


@pytest.mark.parametrize(
    ("terms", "cost", "clearer"),
    [
        (2, 940.0, True),  # explains 0.6 % more of the 9000 that the named effects explain
        (2, 960.0, False),  # 0.4 % more
        (1, 999.0, True),  # needs fewer terms
    ],
)
def test_laws_take_the_place_of_named_effects_only_where_they_are_clearer(
    monkeypatch: pytest.MonkeyPatch, terms: int, cost: float, clearer: bool
) -> None:
    """The nominal model leaves 10,000 and the named effects 1000."""
    monkeypatch.setattr(add, "_as_it_is", lambda *_: SimpleNamespace(cost=1e4))
    search: Any = SimpleNamespace(settings=LawSettings(), of=SimpleNamespace(base={}))
    names = ("torque_offset", "coulomb_friction")

    def explanation(count: int, left: float) -> Any:
        return SimpleNamespace(values={Knob(n, "j1", "torque"): 0.1 for n in names[:count]}, cost=left)

    assert add._clearer(search, explanation(terms, cost), explanation(2, 1000.0)) == clearer


def test_the_slope_of_a_share_has_a_unit() -> None:
    assert [figures._unit_of("gradient", "1", on) for on in ("rad", "m", "N m")] == ["1/rad", "1/m", "1/(N m)"]


def test_what_is_added_beside_a_law_has_no_share_of_another_place() -> None:
    """It may have been a rival, and a bad one, of an effect that is still named."""
    zone, friction = Term("dead_zone", "j1"), Term("coulomb_friction", "j1")
    before, final = (SimpleNamespace(terms=t) for t in ((zone,), (zone, friction)))
    rivalry: Any = Rivalry(before, (), (), {zone: 0.8, friction: 1e-44}, before)  # type: ignore[arg-type]
    assert _still_standing(rivalry, final).shares == {zone: 0.8, friction: 1.0}  # type: ignore[arg-type]
