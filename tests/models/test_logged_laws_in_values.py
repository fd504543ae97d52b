"""A law of a logged column is written into the effect that carries it, alike in replays and in single values."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from plants.diff_drive import DiffDrive
from residual_mpc.effects.laws import CARRIERS, USUAL, curve_shape, is_law, logged_kind, published
from residual_mpc.effects.library import BY_NAME
from residual_mpc.export.augmented import Build, augment
from residual_mpc.models.fits import check_fits
from residual_mpc.models.logged_laws import at_values, columns_at, columns_of, with_columns
from residual_mpc.models.settings import Knob, Settings, Values, assemble
from residual_mpc.models.targets import Targets, targets_of

SLOTS = ("left", "right")
COLUMN = "supply.voltage"


def law(of: str, target: str | None) -> dict[Knob, float]:
    """0.1 at 10, 0.3 at 12, level beyond; usually at 11."""
    name = logged_kind(of, COLUMN).name  # type: ignore[arg-type]
    fixed = {**curve_shape([10.0, 12.0]), USUAL: 11.0, "start": 0.1, "rise2": 0.2}
    return {Knob(name, target, parameter): value for parameter, value in fixed.items()}


def settings(values: Values) -> Settings:
    return assemble([values], {k.effect: SLOTS for k in values})


def test_the_effect_is_known_by_its_name_and_not_listed() -> None:
    name = logged_kind("friction", COLUMN).name
    assert name in BY_NAME and name not in list(BY_NAME) and is_law(name) and published(name) == "fitted_law"
    assert BY_NAME.get(name) is not None and BY_NAME[name].parameter(USUAL).shape
    for other in ("fitted_law_mass_logged:x", "fitted_law_friction_logged:", "friction_logged:x"):
        assert other not in BY_NAME and BY_NAME.get(other) is None
        with pytest.raises(KeyError):
            BY_NAME[other]


def test_without_such_laws_nothing_changes() -> None:
    plain = settings({Knob("actuator_gain", None, "gain"): 0.9})
    assert with_columns(plain, lambda column: np.zeros(1)) is plain
    assert columns_of({Knob("actuator_gain", None, "gain"): 0.9}) == ()


@pytest.mark.parametrize("of", list(CARRIERS))
@pytest.mark.parametrize("target", [None, "right"])
@pytest.mark.parametrize("beside", [(), (None,), ("right",), ("left",), (None, "left")])
def test_single_values_and_replays_agree(of: str, target: str | None, beside: tuple[str | None, ...]) -> None:
    carrier = CARRIERS[of]  # type: ignore[index]
    named = {Knob(carrier.effect, t, carrier.parameter): 0.5 + 0.1 * i for i, t in enumerate(beside)}
    values = {**named, **law(of, target)}
    replayed = with_columns(settings(values), lambda column: np.array([11.5])).effects
    alone = settings(at_values(values, {COLUMN: 11.5})).effects
    assert list(replayed) == [carrier.effect]
    np.testing.assert_allclose(replayed[carrier.effect][carrier.parameter], alone[carrier.effect][carrier.parameter])
    base = named.get(
        Knob(carrier.effect, "right", carrier.parameter), named.get(Knob(carrier.effect, None, carrier.parameter))
    )
    null = BY_NAME[carrier.effect].parameter(carrier.parameter).null
    size = null if base is None else base
    expected = size * 1.25 if carrier.factor else size + 0.25
    assert alone[carrier.effect][carrier.parameter][0, 1] == pytest.approx(expected)


def test_a_column_has_its_usual_value_unless_another_is_given() -> None:
    values = law("strength", None)
    assert columns_at(values) == {COLUMN: 11.0} and columns_at(values, {COLUMN: 12.0}) == {COLUMN: 12.0}
    (gain,) = at_values(values).values()
    assert gain == pytest.approx(1.2)


def test_a_strength_is_never_negative() -> None:
    values = {k: -3.0 if k.parameter == "start" else v for k, v in law("strength", None).items()}
    assert list(at_values(values).values()) == [0.0]


def test_a_law_that_does_nothing_at_one_value_leaves_its_parameters_in_place() -> None:
    """A controller that was compiled at another value of the column asks for as many."""
    values = {k: {"start": 0.0, "rise2": 0.2}.get(k.parameter, v) for k, v in law("strength", None).items()}
    rover = DiffDrive("rover", 0.05, 0.3)
    idle, strong = (augment(rover, values, None, Build(0.05, logged={COLUMN: z})) for z in (10.0, 12.0))
    assert idle.parameters == strong.parameters and len(idle.p) == len(strong.p)
    gain = idle.parameters.index("actuator_gain.left.gain")
    assert idle.p[gain] == 1.0 and strong.p[gain] == pytest.approx(1.2)


def test_a_robot_need_not_know_the_laws() -> None:
    class Bare:
        name = "bare"

        def slots(self, effect: str) -> tuple[str, ...]:
            return {"actuator_gain": SLOTS}.get(effect, ())

        def nominal(self) -> dict[str, float]:
            return {}

    robot: Any = Bare()
    check_fits(law("strength", "left"), robot, "bare", "here")
    assert targets_of(robot, logged_kind("strength", COLUMN).name) == SLOTS
    assert Targets(robot)[logged_kind("strength", COLUMN).name] == SLOTS
