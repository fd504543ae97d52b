"""What the user says was changed on the robot, read and applied to a model."""

from __future__ import annotations

import pytest

from residual_mpc.errors import BadInput
from residual_mpc.experiment.confirmation.known_change import changed_values, read_change
from residual_mpc.models.settings import TUNE, Knob, Term

MASS, GAIN, BIAS = Knob("payload", None, "mass"), Knob("actuator_gain", "left", "gain"), "sensor_bias"
NAMED = [MASS.term, GAIN.term]
SLOTS = {"payload": (), "actuator_gain": ("left", "right"), "sensor_bias": ("pose.theta", "position.j2"),
         "saturation": ("left", "right"), "stribeck_friction": ("j1",)}  # fmt: skip
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
        ("sensor_outliers=0.2", "unknown effect"),  # has no number that a model contains
        ("payload=heavy", "got 'heavy'"),
        ("payload+=none", "got 'none'"),
        ("payload=nan", "got 'nan'"),
        ("payload.weight=1", "no parameter 'weight'"),
        ("stribeck_friction=1", "several parameters"),
        ("actuator_gain@middle=1", "no target 'middle'"),
        ("saturation+=1", "no limit to change"),
    ],
)
def test_a_change_that_cannot_be_read_is_refused(text: str, said: str) -> None:
    with pytest.raises(BadInput) as refused:
        read_change(text, NAMED, SLOTS)
    assert said in str(refused.value) and f"--changed {text}" in str(refused.value)


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
