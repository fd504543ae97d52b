"""What the user says was changed on the robot, read and applied to a model."""

from __future__ import annotations

import pytest

from residual_mpc.errors import BadInput
from residual_mpc.experiment.confirmation.known_change import changed_values, check_change, read_change
from residual_mpc.models.settings import TUNE, Knob, Term

MASS, GAIN, BIAS = Knob("payload", None, "mass"), Knob("actuator_gain", "left", "gain"), "sensor_bias"
NAMED = [MASS.term, GAIN.term]
SLOTS = {
    "payload": ("arm",),
    "actuator_gain": ("left", "right"),
    "saturation": ("left", "right"),
    "coulomb_friction": ("hub",),
    "stribeck_friction": ("j1",),
    "link_mass": ("upper", "lower"),
    "joint_spring": (),
    "sensor_bias": ("pose.theta", "position.j2"),
    "sensor_outliers": ("pose",),
}
TUNED = Knob(TUNE, None, "wheel_radius")
VALUES = {TUNED: 0.1, MASS: 0.3, Knob("payload", None, "x"): 0.02, GAIN: 0.8}


@pytest.mark.parametrize(
    ("text", "knob", "amount", "relative"),
    [
        ("payload+=0.2", MASS, 0.2, True),
        ("payload.mass-=0.2", MASS, -0.2, True),
        ("payload=none", MASS, None, False),
        ("actuator_gain=0.9", GAIN, 0.9, False),  # the target that the diagnosis names
        ("actuator_gain@right=0.9", Knob("actuator_gain", "right", "gain"), 0.9, False),
        ("sensor_bias@position.j2=-0.1", Knob(BIAS, "position.j2", "bias"), -0.1, False),
        ("sensor_bias.bias@pose.theta=0", Knob(BIAS, "pose.theta", "bias"), 0.0, False),
    ],
)
def test_a_change_is_read(text: str, knob: Knob, amount: float | None, relative: bool) -> None:
    change = read_change(text, NAMED, SLOTS)
    assert (change.knob, change.amount, change.relative) == (knob, amount, relative)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("payload", "no '='"),
        ("pay=0.2", "unknown effect 'pay'"),
        ("sensor_outliers=0.2", "has no parameter to change"),
        ("joint_spring=3", "does not exist on this robot"),
        ("link_mass.mass=0.1", "Write link_mass@TARGET"),
        ("payload=heavy", "got 'heavy'"),
        ("payload+=none", "must be a number, got 'none'"),
        ("payload=nan", "got 'nan'"),
        ("payload.weight=1", "no parameter 'weight'"),
        ("stribeck_friction=1", "several parameters"),
        ("actuator_gain@middle=1", "no target 'middle'"),
        ("saturation+=1", "no limit to add to"),
    ],
)
def test_a_change_that_cannot_be_read_is_refused(text: str, said: str) -> None:
    with pytest.raises(BadInput) as refused:
        read_change(text, NAMED, SLOTS)
    assert said in str(refused.value) and f"`changed={text}`" in str(refused.value)


def test_what_no_diagnosis_could_give_a_meaning_is_refused_before_it_is_made() -> None:
    for text in ("pay=0.2", "payload=heavy", "actuator_gain@middle=1", "joint_spring=3"):
        with pytest.raises(BadInput):
            check_change(text, SLOTS)
    check_change("saturation+=1", SLOTS)  # if the diagnosis names a limit


def test_of_two_targets_one_has_to_be_named() -> None:
    two = [Term("actuator_gain", "left"), Term("actuator_gain", "right")]
    with pytest.raises(BadInput, match="left and right"):
        read_change("actuator_gain=1", two, SLOTS)


def test_changes_apply_to_the_values_of_a_model() -> None:
    def after(*texts: str) -> dict[Knob, float]:
        return changed_values(VALUES, [read_change(t, NAMED, SLOTS) for t in texts])

    assert after() == VALUES
    assert after("payload+=0.2")[MASS] == pytest.approx(0.5)
    assert after("payload=0.2")[MASS] == 0.2 and after("payload=0.2")[Knob("payload", None, "x")] == 0.02
    assert after("payload=none") == {TUNED: 0.1, GAIN: 0.8}
    # an effect that the diagnosis does not name begins at nothing
    assert after("actuator_gain@right-=0.1")[Knob("actuator_gain", "right", "gain")] == pytest.approx(0.9)
    assert after("payload=none", "actuator_gain=none") == {TUNED: 0.1}


def test_one_target_of_an_effect_on_all_begins_where_these_are() -> None:
    common = {Knob("actuator_gain", None, "gain"): 0.8}
    left = Knob("actuator_gain", "left", "gain")

    def after(text: str) -> dict[Knob, float]:
        return changed_values(common, [read_change(text, [Term("actuator_gain", None)], SLOTS)])

    assert after("actuator_gain@left-=0.1") == {**common, left: pytest.approx(0.7)}
    assert after("actuator_gain@left=none") == {**common, left: 1.0}
    assert after("actuator_gain=none") == {}
    limit = {Knob("saturation", None, "limit"): 6.0}
    change = read_change("saturation@left+=2", [Term("saturation", None)], SLOTS)
    assert changed_values(limit, [change])[Knob("saturation", "left", "limit")] == 8.0


def test_the_only_target_is_called_as_the_diagnosis_does() -> None:
    for target in (None, "hub"):
        change = read_change("coulomb_friction@hub=0.1", [Term("coulomb_friction", target)], SLOTS)
        assert change.term == Term("coulomb_friction", target)
