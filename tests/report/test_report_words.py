"""Numbers, effects and verdicts in words."""

import math

import pytest
from fabricated_diagnosis import document

from residual_mpc.effects.library import LIBRARY
from residual_mpc.report.wording import sentence
from residual_mpc.report.words.effects import PHRASES, STAGES, sentence_of, stage
from residual_mpc.report.words.groups import group_sentence
from residual_mpc.report.words.numbers import listed, measure, measure_interval, number, percent
from residual_mpc.report.words.rest import hint_of, rest_sentence


def plain(text):
    return text.replace("\N{NO-BREAK SPACE}", " ").replace("\N{MINUS SIGN}", "-")


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0812, "0.0812"), (0.03, "0.03"), (1240.4, "1240"), (0.0, "0"), (-0.5, "-0.5"), (2.5e-6, "2.5 × 10⁻⁶"),
     (None, "–"), (math.nan, "–"), (0.9999, "1"), (99.96, "100")],
)  # fmt: skip
def test_number(value, text):
    assert plain(number(value)) == text


@pytest.mark.parametrize(
    ("share", "text"),
    [(0.857, "86 %"), (0.0123, "1.2 %"), (0.0, "0 %"), (0.0001, "< 0.1 %"), (1.0, "100 %"), (None, "–"),
     (-0.04, "-4 %"), (0.0996, "10 %")],
)  # fmt: skip
def test_percent(share, text):
    assert plain(percent(share)) == text


@pytest.mark.parametrize(
    ("value", "interval", "unit", "text"),
    [
        (0.081, [0.078, 0.084], "s", "81 ms (78 to 84)"),
        (0.62, [0.58, 0.66], "1", "0.62 (0.58 to 0.66)"),
        (12.0, [4.0, 20.0], "N m/rad", "12 N m/rad (4 to 20)"),
        (0.5, None, "kg", "0.5 kg"),
        (0.5, [None, 0.7], "kg", "0.5 kg"),
        (1.0, [1.0, 1.0], "kg", "1.00 kg (1.00 to 1.00)"),
        (-0.07, [-0.09, -0.05], "rad", "-0.070 rad (-0.090 to -0.050), -4°"),
    ],
)
def test_measure_interval(value, interval, unit, text):
    assert plain(measure_interval(value, interval, unit)) == text


def test_measure_carries_degrees():
    assert plain(measure(0.0, "N m")) == "0 N m"
    assert plain(measure(math.pi / 180, "rad")) == "0.0175 rad (1°)"


def test_listed():
    assert [listed("a"), listed("ab"), listed("abc")] == ["a", "a and b", "a, b and c"]


@pytest.mark.parametrize("effect", LIBRARY, ids=lambda e: e.name)
@pytest.mark.parametrize("target", [None, "elbow"])
@pytest.mark.parametrize("value", [0.2, -0.2])
def test_every_effect_of_the_library_has_a_sentence(effect, target, value):
    assert effect.name in PHRASES, "give it a phrase in words/effects.py"
    assert stage({"effect": effect.name}) == effect.stage and effect.stage in STAGES
    parameters = {p.name: {"value": value, "ci95": None, "unit": p.unit} for p in effect.parameters}
    words = sentence_of({"effect": effect.name, "target": target, "parameters": parameters})
    assert "{" not in words and "acts on" not in words
    assert words[0].islower() or words[0].isdigit() or words[0] in "\N{MINUS SIGN}"


def test_a_stranger_is_called_by_its_name():
    assert sentence_of({"effect": "cable_drag", "target": "j2"}) == "cable drag acts on j2"
    assert stage({"effect": "cable_drag"}) == ""


def test_a_negative_value_turns_the_sentence():
    bias = {
        "effect": "sensor_bias",
        "target": "position.j2",
        "parameters": {"bias": {"value": -0.1, "unit": "m"}},
    }
    assert plain(sentence_of(bias)) == "the channel position.j2 reads 0.1 m too low"


def test_wheels_are_called_wheels():
    gain = {"effect": "actuator_gain", "target": "left", "parameters": {"gain": {"value": 0.9, "unit": "1"}}}
    assert plain(sentence_of(gain)) == "the left wheel gives 90 % of what the model expects"


def test_the_verdict_in_one_sentence():
    assert plain(sentence(document("effects"))) == (
        "The robot answers 81 ms late; adding that delay removes 86 % of the gap on runs no fit has seen."
    )
    partial = plain(sentence(document("partial")))
    assert "on stretches no fit has seen" in partial and "no known effect explains the rest" in partial
    assert "learned residual closes 55 %" in plain(sentence(document("unknown")))
    assert sentence(document("no_gap")).endswith("there is no gap to explain.")
    with pytest.raises(KeyError):
        sentence(document("effects") | {"verdict": "perhaps"})


def test_a_group_in_words():
    group = [
        {"effect": "backlash", "target": "j1"},
        [{"effect": "payload", "target": None}, {"effect": "armature"}],
    ]
    assert group_sentence(group) == ("On these runs backlash (j1) and payload with armature cannot be told apart.")


def test_what_is_left_in_words():
    assert plain(rest_sentence(document("unknown")["remainder"])) == (
        "What is left sits in elbow in slow motion and depends on the angle of elbow (62 % of it, 12 times per "
        "revolution): cogging of a motor or the teeth of a gear would look like that. Of the known effects it "
        "resembles viscous friction of elbow most, which closes 31 % of it."
    )
    nothing = plain(rest_sentence(document("partial")["remainder"]))
    assert "depends on nothing that was logged; half of it comes in 12 % of the time, as gusts or bumps" in nothing


def test_a_curve_over_a_speed_is_one_sided_where_its_halves_differ():
    odd = {"kind": "turning", "curve": {"x": [-1.0, 0.0, 1.0], "y": [-0.5, 0.0, 0.5]}}
    weak = {"kind": "turning", "curve": {"x": [-1.0, 0.0, 1.0], "y": [0.0, 0.0, -0.5]}}
    assert not hint_of(odd) and "one side" in hint_of(weak)
