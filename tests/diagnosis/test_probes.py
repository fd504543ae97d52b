"""Values that are worth a first look, in units of what the runs show."""

from __future__ import annotations

from pathlib import Path

import pytest
from oracles.arms import robot_of

from residual_mpc.diagnosis.predict.references import GIVEN, HIGHEST, LOWEST
from residual_mpc.diagnosis.predict.space import Space
from residual_mpc.models.settings import Term
from residual_mpc.models.targets import Targets

GANTRY = """<mujoco><worldbody><body><joint name="lift" type="slide" axis="0 0 1"/><geom size="0.1" mass="1"/>
<body pos="0 0 0.2"><joint name="turn" type="hinge"/><geom size="0.1" mass="1"/></body></body></worldbody>
<actuator><position name="hoist" joint="lift" kp="500"/><position name="spin" joint="turn" kp="5"/></actuator>
</mujoco>"""
REFERENCES = {
    ("torque", "lift"): 2.0, ("torque", "turn"): 0.5, (GIVEN, "turn"): 0.9,
    (HIGHEST, "lift"): 0.05, (LOWEST, "lift"): 0.01, (HIGHEST, "turn"): 1.0, (LOWEST, "turn"): -1.0,
}  # fmt: skip


def doses(folder: Path, term: Term, parameter: str, given: float) -> list[float]:
    """given: N, what the motor of the lift gives at the measured states; the model needs 2 N."""
    robot = robot_of(folder, GANTRY)
    space = Space(robot, Targets(robot), (), (), REFERENCES | {(GIVEN, "lift"): given}, {})
    return [value for probe in space.plausible(term) for k, value in probe.items() if k.parameter == parameter]


@pytest.mark.parametrize(("given", "more"), [(3.9, []), (9.0, [9.0])])
def test_a_friction_as_large_as_what_the_motor_gives_is_tried(tmp_path: Path, given: float, more: list[float]) -> None:
    usual = [0.1, 0.4, 1.0]
    assert doses(tmp_path, Term("coulomb_friction", "lift"), "torque", given) == pytest.approx([*usual, *more])


def test_its_levels_keep_their_ratio_and_its_speed_is_as_before(tmp_path: Path) -> None:
    friction = Term("stribeck_friction", "lift")
    static, kinetic, velocity = (doses(tmp_path, friction, p, 9.0) for p in ("static", "kinetic", "velocity"))
    assert static[-1] == pytest.approx(9.0) and kinetic[-1] == pytest.approx(9.0 * 0.2 / 0.5)
    assert velocity[-1] == velocity[-2]


def test_what_is_no_friction_has_no_such_dose(tmp_path: Path) -> None:
    offset = Term("torque_offset", "lift")
    assert doses(tmp_path, offset, "torque", 9.0) == doses(tmp_path, offset, "torque", 1.0)


@pytest.mark.parametrize(("joint", "rests"), [("lift", [0.09, -0.03, 0.03]), ("turn", [1.5, -1.5, 0.0])])
def test_a_spring_rests_in_the_middle_of_the_motion_or_on_either_side(
    tmp_path: Path, joint: str, rests: list[float]
) -> None:
    """The lift moves from 1 to 5 cm, the other joint from -1 to 1 rad."""
    assert doses(tmp_path, Term("joint_spring", joint), "rest", 1.0) == pytest.approx(rests)
