"""Every change of every effect as a sentence that says what it was and what it is."""

import math
from dataclasses import replace

import pytest
from fabricated_comparison import change, document, number

from residual_mpc.effects.library import BUILT_IN, BY_NAME, LIBRARY
from residual_mpc.effects.phrase import Noun
from residual_mpc.report.words.changes import change_clause, change_line, comparison_sentence, is_ratio
from residual_mpc.report.words.numbers import plain

NUMBERS = [(e, p) for e in BUILT_IN for p in e.parameters if not p.shape]


def clause(*arguments, **keywords):
    return plain(change_clause(change(*arguments, **keywords)))


@pytest.mark.parametrize(("effect", "p"), NUMBERS, ids=[f"{e.name}.{p.name}" for e, p in NUMBERS])
def test_every_number_of_every_effect_has_a_noun(effect, p):
    assert p.name in effect.nouns, "give it a noun"
    kind = effect.nouns[p.name].kind
    assert (kind in ("factor", "ratio")) == (p.null == 1.0)


def test_every_noun_is_of_a_number_that_there_is():
    assert {(e.name, p) for e in BUILT_IN for p in e.nouns} == {(e.name, p.name) for e, p in NUMBERS}


def numbers_of(effect, before, after):
    """Of each of its parameters; None where one of them cannot change like this: a factor is always there, and what is
    there has a number."""
    out = {}
    for p in effect.parameters:
        ratio = p.null == 1.0 or (math.isinf(p.null) and before is not None)
        if (ratio and not (before and after)) or (before is None and not math.isinf(p.null)):
            return None
        value = after if before is None else after / before if ratio else after - before
        out[p.name] = number(before, after, value, 0.01, "1" if ratio else p.unit)
    return out


CHANGES = [(0.2, 0.3), (0.3, 0.2), (0.0, 0.3), (0.3, 0.0), (None, 0.3)]
CASES = [(e, numbers) for e in LIBRARY for ends in CHANGES if (numbers := numbers_of(e, *ends)) is not None]


@pytest.mark.parametrize(("effect", "numbers"), CASES, ids=[f"{e.name}-{k}" for k, (e, _) in enumerate(CASES)])
@pytest.mark.parametrize("target", [None, "elbow"])
def test_every_change_has_a_sentence(effect, numbers, target):
    said = clause(effect.name, target, **numbers)
    assert "{" not in said and "None" not in said and "  " not in said and "(scale)" not in said
    assert any(verb in said for verb in (" increased ", " decreased ", " appeared", " disappeared"))
    bare = [n.appears or n.text for n in effect.nouns.values() if not n.article]
    assert said.startswith(("the ", "a ", "an ", *bare))
    line = plain(change_line(change(effect.name, target, **numbers)))
    assert line.startswith(f"{effect.name} [{target}]: " if target else f"{effect.name}: ") and "None" not in line


@pytest.mark.parametrize(
    ("said", "arguments", "numbers"),
    [
        ("the effective track width increased by 10 %, from 106 % to 117 % of the modelled value",
         ("track_width",), {"scale": number(1.06, 1.166, 1.1, 0.01)}),
        ("the gain of the left wheel decreased by 60 %, from 100 % to 40 % of the modelled value",
         ("actuator_gain", "left"), {"gain": number(1.0, 0.4, 0.4, 0.01)}),
        ("the actuator gain increased by a factor of 3.2, from 50 % to 160 % of the modelled value",
         ("actuator_gain",), {"gain": number(0.5, 1.6, 3.2, 0.01)}),
        ("the ratio of right to left wheel radius decreased by 5 %, from 1 to 0.95",
         ("wheel_radius_mismatch",), {"ratio": number(1.0, 0.95, 0.95, 0.01)}),
        ("the command delay increased by 45 ms, from 71 ms to 116 ms",
         ("command_delay",), {"delay": number(0.071, 0.116, 0.045, 0.01, "s")}),
        ("a command delay appeared (78 ms)", ("command_delay",), {"delay": number(0.0, 0.078, 0.078, 0.01, "s")}),
        ("the lag of actuator j1 disappeared (59 ms before)",
         ("actuator_lag", "j1"), {"time_constant": number(0.059, 0.0, -0.059, 0.01, "s")}),
        ("an output limit of actuator j1 appeared (5 N m)",
         ("saturation", "j1"), {"limit": number(None, 5.0, 5.0, 0.1, "N m")}),
        ("the output limit decreased by 20 %, from 5 to 4", ("saturation",), {"limit": number(5.0, 4.0, 0.8, 0.01)}),
        ("elasticity appeared in the gear of j1 (stiffness 40 N m/rad)",
         ("joint_compliance", "j1"), {"stiffness": number(None, 40.0, 40.0, 2.0, "N m/rad")}),
        ("backlash appeared in the gear of j1 (0.0349 rad, 2°)",
         ("backlash", "j1"), {"gap": number(0.0, 0.0349, 0.0349, 0.001, "rad")}),
        ("the payload increased by 0.25 kg",
         ("payload",), {"mass": number(0.02, 0.27, 0.25, 0.02, "kg")}),
        ("the payload decreased by 0.25 kg", ("payload",), {"mass": number(0.25, 0.0, -0.25, 0.02, "kg")}),
        ("the dry friction of joint elbow increased by 13 mN m",
         ("coulomb_friction", "elbow"), {"torque": number(0.0, 0.013, 0.013, 0.001, "N m")}),
        ("the loss of gain increased from 1 % per second to 2 % per second",
         ("voltage_sag",), {"rate": number(0.01, 0.02, 0.01, 0.001, "1/s")}),
        ("outliers appeared (3 %)", ("sensor_outliers",), {"rate": number(0.0, 0.03, 0.03, 0.001)}),
        ("lateral slip appeared (coefficient 100 ms)",
         ("lateral_slip",), {"coefficient": number(0.0, 0.1, 0.1, 0.01, "s")}),
    ],
)  # fmt: skip
def test_sentences(said, arguments, numbers):
    assert clause(*arguments, **numbers) == said


def test_of_several_numbers_those_are_said_that_did_not_stay():
    moved, stayed = number(0.0, 0.2, 0.2, 0.05, "kg"), number(0.0, 0.001, 0.001, 0.01, "m")
    assert clause("link_mass", "forearm", mass=moved, com=stayed) == "the mass of link forearm increased by 0.2 kg"
    both = clause("link_mass", "forearm", mass=number(0.0, 0.2, 0.2, 0.5, "kg"), com=stayed)
    assert "mass of link forearm" in both and "centre of mass" in both


def test_a_number_that_has_stayed_is_as_before():
    """A fit leaves rounding errors."""
    static, kinetic = number(0.0, 0.1, 0.1, 0.02, "N m"), number(0.0, 5e-19, 5e-19, 5e-19, "N m")
    line = plain(change_line(change("stribeck_friction", static=static, kinetic=kinetic)))
    assert "static 0 -> 0.1 N m, change 0.100 N m" in line and "kinetic 0, as before" in line, line


def test_numbers_that_say_only_how_an_effect_acts_are_left_to_the_details():
    numbers = {"rate": number(0.0, 0.02, 0.02, 0.001, "m/s"), "heading": number(0.0, 0.5, 0.5, 0.1, "rad")}
    assert clause("slope", **numbers) == "a drift in a fixed direction appeared (20 mm/s)"
    assert "heading 0.5 rad (29°)" in plain(change_line(change("slope", **numbers)))


def test_a_doubtful_change_is_a_possibility():
    assert clause("payload", probability=0.4, mass=number(0.0, 0.3, 0.3, 0.1, "kg")).startswith("possibly the payload")


def test_a_stranger_is_called_by_its_name():
    one = change("cable_drag", "j2", force=number(0.1, 0.3, 0.2, 0.05, "N"))
    assert plain(change_clause(one)) == "the cable drag (force) of j2 increased by 0.2 N, from 0.1 N to 0.3 N"
    assert not is_ratio(one, "force")
    assert is_ratio(change("cable_drag", None, scale=number(0.5, 1.0, 2.0, 0.05)), "scale")
    assert plain(change_clause(change("cable_drag", "j2"))) == "cable drag of j2 changed"


def test_an_own_effect_names_its_parameters(monkeypatch):
    own = replace(BY_NAME["command_delay"], name="slack", nouns={"delay": Noun("slack of the belt")}, own=True)
    monkeypatch.setitem(BY_NAME, "slack", own)
    said = clause("slack", delay=number(0.1, 0.3, 0.2, 0.05, "s"))
    assert said == "the slack of the belt increased by 200 ms, from 100 ms to 300 ms"


def test_only_target_is_named():
    one = change("actuator_lag", time_constant=number(0.05, 0.1, 0.05, 0.01, "s")) | {"only_target": "servo"}
    assert plain(change_clause(one)).startswith("the lag of actuator servo increased")


def test_sentences_of_the_verdicts():
    faint = document("changed")
    faint["changes"] = [*faint["changes"], {**faint["changes"][0], "probability": 0.01}]
    assert comparison_sentence(faint) == comparison_sentence(document("changed"))
    assert comparison_sentence(document("same")).startswith("No change found: ")
    assert comparison_sentence(document("unknown")).startswith("The two sets differ, but no change of an effect")
    partial = document("partial")
    assert comparison_sentence(partial).endswith(
        "this explains the gap, but the errors of the two sets still differ."
    )
    partial["unexplained"]["p"] = 0.2
    assert comparison_sentence(partial).endswith("but another change explains the runs better (see the notes).")
    partial["unexplained"]["share"] = 0.4
    assert comparison_sentence(partial).endswith("this explains only part of the difference between the two sets.")
    assert "explains only part" not in comparison_sentence(document("changed"))


def test_what_is_nothing_beside_the_other_side_is_zero():
    line = plain(change_line(change("sensor_delay", None, delay=number(6.24e-8, 0.03, 0.03, 0.001, "s"))))
    assert line.startswith("sensor_delay: delay 0 -> 30 ms, change 30 ms")
    assert " 0.01 -> 1," in plain(change_line(change("actuator_gain", None, gain=number(0.01, 1.0, 100.0, 1.0))))
