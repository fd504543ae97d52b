"""A law of dry friction is stated as it acts: a joint has no less than none."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from oracles.arms import SERVOS, arm_xml, robot_of

from residual_mpc.diagnosis.laws.figures import FittedLaw, fitted_law
from residual_mpc.diagnosis.predict.space import Space
from residual_mpc.effects.laws import LEVELS, curve, curve_shape
from residual_mpc.effects.library import LIBRARY
from residual_mpc.effects.ops import NUMPY
from residual_mpc.models.settings import TUNE, Knob, Term, Values

RUBBING = Term("fitted_law_friction_position", "j2")
KNOTS = (-1.0, 0.0, 1.0, 2.0)
STRIBECK = {Knob("stribeck_friction", None, name): 0.1 for name in ("static", "kinetic", "velocity")}
LOSS = 0.02  # N m, the dry friction of this joint in the model


def stated(tmp_path: Path, levels: tuple[float, ...], named: Values) -> tuple[FittedLaw, dict[str, float]]:
    """The law on a joint with LOSS, each of whose numbers is known to 0.1 N m; and all of its numbers."""
    robot = robot_of(tmp_path, arm_xml(SERVOS))
    shape = curve_shape(KNOTS)
    numbers = {**shape, **dict(zip(LEVELS, [levels[0], *np.diff(levels)], strict=False))}
    free = {Knob(*RUBBING[:2], name): float(numbers[name]) for name in LEVELS[: len(KNOTS)]}
    fixed = {Knob(*RUBBING[:2], name): v for name, v in shape.items()}
    references = {("torque", j): 0.4 for j in robot.joints}
    space = Space(robot, {e.name: robot.slots(e.name) for e in LIBRARY}, (), (), references, {}, fixed=fixed)
    values = {**free, **named}
    return fitted_law(space, RUBBING, "curve", values, list(free), 0.01 * np.eye(len(free))), numbers


@pytest.mark.parametrize("known", [0.0, 0.2])
def test_a_friction_below_none_is_stated_as_none(tmp_path: Path, known: float) -> None:
    """known: N m, a constant friction that is named beside the law, which may take it away as well."""
    beside = {Knob("coulomb_friction", "j2", "torque"): known} if known else {}
    levels, least, z = (-1.4, 0.8, 0.7, -1.5), -LOSS - known, np.linspace(-1.5, 2.5, 401)
    law, numbers = stated(tmp_path, levels, beside)
    fitted, _ = stated(tmp_path, levels, STRIBECK)  # beside which it is stated as it was fitted
    assert (law.form, dict(law.numbers)) == ("curve", {})
    assert set(KNOTS) < set(law.knots) and (np.diff(law.knots) > 0.0).all()
    assert np.interp(z, law.knots, law.values) == pytest.approx(np.maximum(curve(NUMPY, numbers, z), least))
    for side in ("low", "values", "high"):
        clipped = np.maximum(np.interp(z, fitted.knots, getattr(fitted, side)), least)
        assert np.interp(z, law.knots, getattr(law, side)) == pytest.approx(clipped)


def test_a_law_that_leaves_some_friction_is_stated_as_it_is(tmp_path: Path) -> None:
    levels = (-0.01, 0.8, 0.7, 0.0)
    law, _ = stated(tmp_path, levels, {})
    assert (law.knots, law.values) == (KNOTS, pytest.approx(levels))
    assert law.low[0] < -LOSS  # its uncertainty is that of the fit


def test_beside_a_friction_that_varies_the_law_is_stated_as_it_was_fitted(tmp_path: Path) -> None:
    law, _ = stated(tmp_path, (-1.4, 0.8, 0.7, -1.5), STRIBECK)
    assert (law.knots, min(law.values)) == (KNOTS, pytest.approx(-1.5))


def test_beside_another_law_of_friction_it_is_stated_as_it_was_fitted(tmp_path: Path) -> None:
    warming = {Knob("fitted_law_friction_time", "j2", "start"): 0.5}
    law, _ = stated(tmp_path, (-0.4, 0.8, 0.7, 0.6), warming)
    assert (law.knots, min(law.values)) == (KNOTS, pytest.approx(-0.4))


def test_a_friction_of_all_joints_counts_as_well(tmp_path: Path) -> None:
    law, _ = stated(tmp_path, (-0.4, 0.8, 0.7, 0.6), {Knob("coulomb_friction", None, "torque"): 0.3})
    assert min(law.values) == pytest.approx(-LOSS - 0.3)


def test_beside_a_friction_of_the_model_that_is_tuned_it_is_stated_as_it_was_fitted(tmp_path: Path) -> None:
    law, _ = stated(tmp_path, (-0.4, 0.8, 0.7, 0.6), {Knob(TUNE, None, "joint.j2.frictionloss"): 0.5})
    assert (law.knots, min(law.values)) == (KNOTS, pytest.approx(-0.4))
