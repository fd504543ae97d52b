"""Intervals of changed forces beside a gain that may stand for heavier links."""

from __future__ import annotations

from pathlib import Path

import pytest
from oracles.arms import SERVOS, arm_xml, robot_of

from residual_mpc.comparison.force_scale import force_scales, with_force_scales
from residual_mpc.models.settings import Knob, Term

ALL, ONE = Knob("actuator_gain", None, "gain"), Knob("actuator_gain", "j1", "gain")
CHANGED = Knob("actuator_gain", None, "gain", changed=True)
HOIST = Knob("actuator_gain", "hoist", "gain")
OTHER = Knob("coulomb_friction", "j1", "torque")


@pytest.mark.parametrize(
    ("term", "values", "expected"),
    [
        (Term("joint_spring", "j1"), {ALL: 0.9, OTHER: 0.3}, (0.9,)),
        (Term("payload", None), {ONE: 0.8}, (0.8,)),
        (Term("coulomb_friction", "j1"), {ONE: 0.8}, (0.8,)),
        (Term("coulomb_friction", "j2"), {ONE: 0.8}, ()),  # another motor's
        (Term("payload", None), {CHANGED: 0.8}, ()),  # only the later runs have it
        (Term("link_mass", "lower"), {ONE: 0.8}, (0.8,)),  # a link weighs on any motor
        (Term("joint_spring", "j2"), {HOIST: 0.7, ALL: 0.9}, (0.7, 0.9)),  # its motor has another name
    ],
)
def test_gains_of_both_sets_at_the_joint_count(
    term: Term, values: dict[Knob, float], expected: tuple[float, ...], tmp_path: Path
) -> None:
    servos = SERVOS.replace('name="j2"', 'name="hoist"')
    assert force_scales(robot_of(tmp_path, arm_xml(servos)), values, term) == expected


@pytest.mark.parametrize(
    ("unit", "scales", "expected"),
    [
        ("N m/rad", (0.8,), (1.0, 1.5)),
        ("kg", (1.25,), (0.8, 1.2)),
        ("kg", (), (1.0, 1.2)),
        ("s", (0.8,), (1.0, 1.2)),  # a delay does not depend on forces
        ("1", (0.8,), (1.0, 1.2)),
    ],
)
def test_an_interval_of_a_force_reaches_to_where_lighter_or_heavier_links_would_put_it(
    unit: str, scales: tuple[float, ...], expected: tuple[float, float]
) -> None:
    assert with_force_scales((1.0, 1.2), unit, scales) == pytest.approx(expected)


def test_a_decrease_reaches_as_far() -> None:
    assert with_force_scales((-1.2, -1.0), "N m", (0.8,)) == pytest.approx((-1.5, -1.0))
