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
from residual_mpc.models.settings import Knob, Term, Values

RUBBING = Term("fitted_law_friction_position", "j2")
KNOTS = (-1.0, 0.0, 1.0, 2.0)
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
    law, numbers = stated(tmp_path, (-1.4, 0.8, 0.7, -1.5), beside)
    least = -LOSS - known
    assert min(law.values) == pytest.approx(least)
    assert len(law.knots) == len(KNOTS) + 2
    z = np.linspace(-1.5, 2.5, 401)
    assert np.interp(z, law.knots, law.values) == pytest.approx(np.maximum(curve(NUMPY, numbers, z), least))
    assert all(low <= v <= high and low >= least for low, v, high in zip(law.low, law.values, law.high, strict=True))


def test_a_law_that_leaves_some_friction_is_stated_as_it_is(tmp_path: Path) -> None:
    levels = (-0.01, 0.8, 0.7, 0.0)
    law, _ = stated(tmp_path, levels, {})
    assert (law.knots, law.values) == (KNOTS, pytest.approx(levels))
    assert law.low[0] < -LOSS  # its uncertainty is that of the fit


def test_beside_a_friction_that_varies_the_law_is_stated_as_it_was_fitted(tmp_path: Path) -> None:
    stribeck = {Knob("stribeck_friction", None, name): 0.1 for name in ("static", "kinetic", "velocity")}
    law, _ = stated(tmp_path, (-1.4, 0.8, 0.7, -1.5), stribeck)
    assert (law.knots, min(law.values)) == (KNOTS, pytest.approx(-1.5))

