"""Numbers, effects and verdicts in words."""

import math
from typing import Any

import pytest
from fabricated_diagnosis import document

from residual_mpc.effects.effect import STAGES
from residual_mpc.effects.library import BY_NAME, LIBRARY
from residual_mpc.report.words.effects import name, remarks, sentence_of, sizes_words, stage, variation_clause
from residual_mpc.report.words.gaps import few_windows, floor_matters, horizon_line, warnings
from residual_mpc.report.words.groups import group_sentence, member_names, or_else
from residual_mpc.report.words.laws import law_sentence
from residual_mpc.report.words.numbers import (
    in_brackets,
    listed,
    measure,
    measure_interval,
    number,
    percent,
    percent_of_nominal,
    spelled,
)
from residual_mpc.report.words.rest import hint_of, rest_sentence
from residual_mpc.report.words.summary import sentence


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
        (0.967, [0.617, 2.64], "1", "1.0 (0.6 to 2.6)"),  # to the nearer side
        (0.259, [0.001, 3.29], "m/s", "0.3 m/s (0.0 to 3.3)"),
        (12.0, [11.99, 20.0], "kg", "12.0 kg (12.0 to 20.0)"),
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
    assert effect.phrase is not None, "give it a phrase"
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
    assert plain(sentence_of(bias)) == "channel position.j2 reads 0.1 m too low"


def test_wheels_are_called_wheels():
    gain = {"effect": "actuator_gain", "target": "left", "parameters": {"gain": {"value": 0.9, "unit": "1"}}}
    assert plain(sentence_of(gain)) == "the left wheel delivers 90 % of its modelled output"


@pytest.mark.parametrize(
    ("effect", "target", "parameters", "text"),
    [
        ("dead_zone", "elbow", {"width": (0.01, "rad")},
         "actuator elbow ignores position errors smaller than 0.01 rad (0.57°)"),
        ("dead_zone", "left", {"width": (0.3, "rad/s")}, "the left wheel ignores commands smaller than 0.3 rad/s"),
        ("saturation", "elbow", {"limit": (3.0, "N m")}, "the torque of actuator elbow saturates at 3 N m"),
        ("saturation", None, {"limit": (8.0, "rad/s")}, "the speed of every actuator saturates at 8 rad/s"),
        ("armature", None, {"inertia": (-0.2, "kg m^2")}, "every joint has 0.2 kg m² less rotor inertia than modelled"),
        ("track_width", None, {"scale": (3.34, "1")}, "the robot turns as if its track were 3.34 times as wide"),
        ("command_delay", "j2", {"delay": (0.09, "s")}, "commands to j2 take effect 90 ms late"),
        ("no_such_effect", "j2", {"amplitude": (0.2, "N m")}, "no such effect acts on j2"),
        ("stribeck_friction", "j1", {"static": (-0.2, "N m"), "kinetic": (-0.1, "N m")},
         "the friction of joint j1 differs from the model by -0.2 N m near standstill and -0.1 N m at speed"),
    ],
)  # fmt: skip
def test_clauses_fit_arms_and_wheels(effect, target, parameters, text):
    written = {k: {"value": v, "ci95": None, "unit": u} for k, (v, u) in parameters.items()}
    assert plain(sentence_of({"effect": effect, "target": target, "parameters": written})) == text


@pytest.mark.parametrize(
    ("mass", "com", "text"),
    [
        ((0.2, [0.1, 0.3]), (-0.089, [-0.11, -0.07]), "link load is 0.2 kg heavier than modelled"),
        ((-0.018, [-0.17, 0.328]), (0.01, [-0.02, 0.04]), "link load is 18 g lighter than modelled"),
        ((-0.018, None), (-0.089, [-0.11, -0.07]), "link load is 18 g lighter than modelled"),
        ((-0.018, [-0.17, 0.328]), (-0.089, None), "link load is 18 g lighter than modelled"),
        ((-0.018, [-0.17, 0.328]), (-0.089, [-0.11, -0.07]),
         "the centre of mass of link load is 89 mm closer to its joint than modelled"),
        ((0.018, [-0.17, 0.328]), (0.089, [0.07, 0.11]),
         "the centre of mass of link load is 89 mm farther from its joint than modelled"),
    ],
)  # fmt: skip
def test_a_clause_names_the_number_that_is_clearly_there(mass, com, text):
    parameters = {"mass": dict(zip(("value", "ci95"), mass, strict=True), unit="kg"),
                  "com": dict(zip(("value", "ci95"), com, strict=True), unit="m")}  # fmt: skip
    assert plain(sentence_of({"effect": "link_mass", "target": "load", "parameters": parameters})) == text


def test_a_fitted_law_is_told_from_an_effect_with_a_name():
    law = {"effect": "fitted_law", "target": "j2", "on": "the speed of j2",
           "parameters": {"values": {"value": [0.1, -0.2], "unit": "N m"}}}  # fmt: skip
    assert sentence_of(law) == "a function of the speed of j2, fitted to the runs, corrects j2"


def test_people_are_written_with_a_capital():
    assert name({"effect": "coulomb_friction"}) == "Coulomb friction"


def test_what_supports_an_effect_in_words():
    entry = {"evidence": ["fits", "survives"], "since": {"run": "one", "t": 131.0}, "by_run": {"one": 0.8, "two": 0.9},
             "until": {"run": "two", "t": 140.0}, "note": "at the bound of its search range"}  # fmt: skip
    assert [plain(text) for text in remarks(entry, lambda run, t: t - 100.0)] == [
        "fits significantly better and is found whichever run is left out",
        "begins 31 s into one",
        "ends 40 s into two",
        "by run: one 0.8, two 0.9",
        "at the bound of its search range",
    ]
    assert remarks({"effect": "payload"}, lambda run, t: t) == []
    many = {"by_run": {f"run{k}": k / 10 for k in range(20)}}
    assert sizes_words(many) == "varies over 20 runs: 0 to 1.9, median 0.95"


def test_an_effect_that_is_not_steady_says_so_in_its_clause():
    gain = {"effect": "actuator_gain", "target": None, "parameters": {"gain": {"value": 0.8, "unit": "1"}}}
    assert variation_clause(gain) == ""
    assert variation_clause({**gain, "by_run": {"a": 0.6, "b": 0.9}}) == ", varying from run to run (0.6 to 0.9)"
    sizes = {"by_motion": {"small": 0.7, "medium": 0.8, "large": 0.9}}
    assert variation_clause({**gain, **sizes}) == ", varying with the size of the motion (0.7 to 0.9)"
    assert sizes_words(sizes) == "in small, medium and large motions: 0.7, 0.8 and 0.9"
    acting = {"by_influence": {"weak": 0.7, "medium": 0.8, "strong": 0.9}}
    assert variation_clause({**gain, **acting}) == ", varying with its influence on the motion (0.7 to 0.9)"
    assert sizes_words(acting) == "where its influence is weak, medium and strong: 0.7, 0.8 and 0.9"
    limit = {"by_run": {"a": 4.0}, "free": ["b", "c"]}
    assert variation_clause({**gain, **limit}) == ", in a only"
    assert remarks({**gain, **limit}, lambda run, t: t)[-1] == "restricts nothing in b and c"
    soft = {"parameters": {"stiffness": {"value": 80.0, "unit": "N m/rad"}}, "by_motion": {"large": 80.0}}
    assert remarks({**gain, **soft, "free": ["small"]}, lambda run, t: t)[-1] == "is rigid in small motions"
    placed = {"by_position": {"low": 0.7, "middle": 0.8, "high": 0.9}}
    assert variation_clause({**gain, **placed}) == ", varying with the position of the joint (0.7 to 0.9)"
    assert sizes_words(placed) == "at low, middle and high positions: 0.7, 0.8 and 0.9"
    assert variation_clause({**gain, "since": {"run": "b", "t": 3.0}}) == ", beginning in b"
    assert variation_clause({**gain, "until": {"run": "b", "t": 3.0}}) == ", ending in b"


@pytest.mark.parametrize(
    ("unit", "text", "label"),
    [("1", "", ""), ("", "", ""), ("rad/s^2", "rad/s²", " (rad/s²)"), ("1/turn", "per turn", " (per turn)")],
)
def test_units_as_they_are_printed(unit, text, label):
    assert plain(spelled(unit)) == text and plain(in_brackets(unit)) == label


def test_the_verdict_in_one_sentence():
    assert plain(sentence(document("effects"))) == (
        "Commands take effect 81 ms late; adding this delay to the model removes 86 % of the gap on held-out runs."
    )
    partial = plain(sentence(document("partial")))
    assert partial.endswith(
        "removes 38 % of the gap on held-out parts of the runs and leaves 20 times the noise floor unexplained."
    )
    assert plain(sentence(document("unknown"))) == (
        "Over 1 s the model misses 21 % of the motion, 10 times the noise floor, and no effect in the library explains "
        "a significant part of it; a learned residual removes 55 % of it."
    )
    assert sentence(document("no_gap")).endswith("there is no gap to explain.")
    with pytest.raises(KeyError):
        sentence(document("effects") | {"verdict": "perhaps"})


def test_the_surest_effect_comes_first_and_a_doubtful_one_is_a_possibility():
    said = plain(sentence(document("partial")))
    assert said.startswith("Joint elbow has 13.1 mN m more dry friction than modelled, the gear of shoulder_lift has ")
    assert "too low and possibly actuator wrist delivers 62 % of its modelled output, beginning in run1; adding" in said
    alone = document("effects")
    alone["explanation"][0]["probability"] = 0.19
    assert sentence(alone).startswith("Possibly commands take effect")


@pytest.mark.parametrize(("probability", "text"), [(0.9, "3 more effects"), (0.2, "possibly 3 more effects")])
def test_effects_that_are_counted_are_doubted_like_the_rest(probability, text):
    many = document("partial")
    many["explanation"] = [many["explanation"][0]] + [many["explanation"][2] | {"probability": probability}] * 5
    assert f" and {text} contribute; adding" in sentence(many)


def test_a_faint_effect_is_counted_and_not_said():
    found = document("partial")
    surest = max(found["explanation"], key=lambda e: e["probability"])
    found["explanation"] = [surest, found["explanation"][0] | {"probability": 0.05}]
    said = sentence(found)
    assert said.count("possibly") == 1 and " and possibly 1 more effect contributes; adding" in said
    found["explanation"] = found["explanation"][1:]
    assert sentence(found).startswith("Possibly ") and "more effect" not in sentence(found)


@pytest.mark.parametrize(
    ("factor", "text"), [(1.0251, "102.5 %"), (0.97, "97 %"), (0.62, "62 %"), (1.2, "120 %"), (1.0, "100 %")]
)
def test_a_factor_near_one_has_a_tenth_of_a_per_cent(factor, text):
    assert plain(percent_of_nominal(factor)) == text


def test_a_number_at_the_bound_of_its_search_range_says_so():
    partial = document("partial")
    gain = {"value": 5.0, "unit": "1", "note": "at the bound of its search range"}
    partial["explanation"] = [
        {"effect": "actuator_gain", "target": "a2", "probability": 0.3, "parameters": {"gain": gain}}
    ]
    assert plain(sentence(partial)).startswith(
        "Possibly actuator a2 delivers 500 % of its modelled output (at the bound of its search range); modelling this "
    )


def test_what_is_left_is_said_at_the_horizon_where_most_is():
    slow = document("partial")
    far = {"horizon": 5.0, "before": 0.6, "after": 0.3, "noise_floor": 0.03}
    slow["gap"] |= {"after": 0.03, "horizons": [slow["gap"] | {"after": 0.03}, far]}
    assert plain(sentence(slow)).endswith("and leaves 10 times the noise floor unexplained at 5 s.")


def test_a_small_rest_with_a_size_that_varies_is_said_to_follow_another_law():
    small = document("partial")
    small["gap"] |= {"after": 1.5 * small["gap"]["noise_floor"], "horizons": []}
    first = small["explanation"][0]
    first.pop("by_run", None)
    assert "follows another law" not in sentence(small)
    first["by_position"] = {"low": 0.6, "middle": 0.7, "high": 0.8}
    assert plain(sentence(small)).endswith("depends on the joint's position, so the true cause follows another law.")
    small["gap"]["after"] = 5.0 * small["gap"]["noise_floor"]
    assert plain(sentence(small)).endswith("times the noise floor unexplained.")


def test_no_gain_on_held_out_runs_is_said():
    worse = document("partial")
    worse["shrink"] |= {"value": -0.04}
    assert "does not reduce the gap on held-out parts of the runs" in sentence(worse)
    assert "on the runs used in the fit" in sentence(document("effects") | {"held_out": []})


@pytest.mark.parametrize(
    ("gap", "explained", "text"),
    [
        ({"horizon": 5.0, "before": 0.12, "after": 0.03, "noise_floor": 0.02}, True,
         "gap at 5 s: 0.12 -> 0.03 (noise floor 0.02)"),
        ({"horizon": 1.0, "before": 0.12, "after": 0.12, "noise_floor": 0.02, "windows": 1}, False,
         "gap at 1 s: 0.12 (noise floor 0.02), 1 window"),
        ({"horizon": 30.0, "nominal": 0.12, "model": 0.03, "noise_floor": 0.0213, "held_out": False}, True,
         "gap at 30 s: 0.12 -> 0.03 (noise floor 0.021), not held out"),
        ({"horizon": 1.0, "nominal": 0.18, "before": 0.12, "after": 0.03, "noise_floor": 0.02}, True,
         "gap at 1 s: 0.18, retuned 0.12 -> 0.03 (noise floor 0.02)"),
        ({"horizon": 1.0, "nominal": 0.12, "model": None, "noise_floor": 0.02}, True,
         "gap at 1 s: 0.12 (noise floor 0.02)"),
    ],
)  # fmt: skip
def test_a_horizon_in_one_line(gap, explained, text):
    assert plain(horizon_line(gap, explained)) == text


def test_a_model_that_is_worse_than_constant_velocity_is_said():
    gap = {"nominal": 0.6, "before": 0.5, "after": 0.3, "noise_floor": 0.02, "horizon": 1.0, "constant_velocity": 0.38}
    nothing = "a constant-velocity forecast (0.38), so its figures are not meaningful for these runs."
    assert warnings(gap, True) == [f"The nominal model predicts worse than {nothing}"]
    assert warnings(gap | {"after": 0.4}, True)[0].startswith("The nominal and the final model predict worse")
    assert warnings(gap, False) == [f"This model predicts worse than {nothing}"]
    assert warnings(gap | {"constant_velocity": 0.7}, True) == []
    small = {"nominal": 0.1, "before": 0.1, "noise_floor": 0.02, "horizon": 1.0, "constant_velocity": 0.08}
    assert warnings(small, False) == ["This model predicts worse than a constant-velocity forecast (0.08)."]
    assert warnings(gap | {"after": 0.381}, True)[1:] == [
        "The final model predicts no better than a constant-velocity forecast (0.38)."
    ]
    assert warnings({"nominal": 4080.0, "model": None, "noise_floor": 0.1, "horizon": 1.0}, True) == [
        "The nominal model diverges to 4080 times the motion itself: a model that predicts no motion would be better."
    ]


def test_a_forecast_that_a_few_windows_make_better_does_not_make_the_figures_useless():
    quantiles = {"p50": 0.01, "p90": 0.4, "max": 3.6}
    gap = {"nominal": 0.63, "noise_floor": 0.003, "horizon": 1.0, "constant_velocity": 0.55,
           "window_gaps": {"nominal": quantiles}}  # fmt: skip
    assert warnings(gap, False) == ["This model predicts worse than a constant-velocity forecast (0.55)."]
    assert "not meaningful" in warnings(gap | {"window_gaps": {"nominal": {**quantiles, "p50": 0.5}}}, False)[0]


def test_noise_that_a_correct_model_would_not_predict_is_no_fault_of_the_model():
    gap = {"nominal": 1.63, "noise_floor": 1.4, "horizon": 1.0, "constant_velocity": 0.71}
    (said,) = warnings(gap, False)
    assert said == (
        "At 1 s, noise in the measured start state alone produces a gap of 1.4, even for a correct model: these runs "
        "cannot test the model at this horizon. Shorten it (for example --horizon 0.25)."
    )
    unknown = {"verdict": "unknown", "explanation": [], "gap": gap | {"before": 1.63, "after": 1.63, "blinded": True}}
    assert sentence(unknown).endswith("Shorten the horizon (for example --horizon 0.25), or record calmer motions.")
    assert "not meaningful" in warnings(gap | {"nominal": 4.2}, False)[0]
    assert warnings(gap | {"nominal": 0.6, "noise_floor": 0.4}, False) == []


@pytest.mark.parametrize(("nominal", "longer", "matters"), [(0.05, 0.9, True), (0.9, 0.05, True), (0.9, 0.9, False)])
def test_the_floor_matters_near_it(nominal, longer, matters):
    one = {"horizon": 1.0, "nominal": nominal, "noise_floor": 0.02}
    gap = {**one, "horizons": [one, {"horizon": 5.0, "nominal": longer, "noise_floor": 0.02}]}
    assert floor_matters(gap) is matters


def test_a_few_windows_that_rule_the_gap_are_said():
    quantiles = {"p50": 0.06, "p90": 0.3, "max": 5.0}
    gap = {"horizon": 1.0, "before": 0.5, "after": 0.35, "noise_floor": 0.02, "window_gaps": {"after": quantiles}}
    assert few_windows(gap, True) == (
        "A few windows dominate the gap at 1 s: the median over the windows is 0.06, the maximum 5."
    )
    assert few_windows(gap, False) == "" and few_windows(gap | {"after": 0.1}, True) == ""
    told = gap | {"window_gaps": {"after": quantiles | {"run": "r07", "from": 8.0}}}
    assert few_windows(told, True).endswith("the maximum 5 (r07, 8 to 9 s).")


def test_a_group_in_words():
    group = [
        {"effect": "backlash", "target": "j1"},
        [{"effect": "payload", "target": None}, {"effect": "armature"}],
    ]
    assert group_sentence(group) == (
        "On these runs backlash (j1) and payload together with armature cannot be told apart."
    )


def test_one_of_a_group_is_called_all_where_another_has_it_on_one_target():
    group = [{"effect": "saturation", "target": "m2"}, {"effect": "saturation", "target": None}]
    assert group_sentence(group) == "On these runs saturation (m2) and saturation (all) cannot be told apart."
    assert member_names([{"effect": "payload", "target": None}, {"effect": "armature", "target": None}]) == [
        "payload",
        "armature",
    ]


GAIN = {"effect": "actuator_gain", "target": "right"}
RATIO = {"effect": "wheel_radius_mismatch", "target": None}
DELAY = {"effect": "command_delay", "target": None}


@pytest.mark.parametrize(
    ("group", "probabilities", "end"),
    [
        ([GAIN, RATIO], (0.02, 0.76), "; wheel radius mismatch (0.76) is likelier."),
        ([RATIO, GAIN], (0.02, 0.76), "; wheel radius mismatch (0.76) is likelier."),  # wherever the named one stands
        ([GAIN, RATIO], (0.40, 0.45), "; one of them is present (probability 0.85)."),
        ([GAIN, RATIO], (0.96, 0.9), "; one of them is present (probability 0.97)."),
        ([DELAY, RATIO], (0.4, 0.45), "."),  # none of them is named
        ([GAIN, RATIO], (0.2, 0.25), "."),
        ([DELAY, RATIO], (0.02, 0.76), "."),  # none of them is named
        ([RATIO, [GAIN, DELAY]], (0.02, 0.76), "."),  # a pair has no probability of its own
        ([GAIN, DELAY], (0.02, 0.76), "."),  # nor has what was not a candidate
    ],
)
def test_a_group_says_which_member_is_clearly_likelier_than_the_named_one(group, probabilities, end):
    candidates = [{**member, "probability": p} for member, p in zip((GAIN, RATIO), probabilities, strict=True)]
    found = group_sentence(group, {"explanation": [GAIN], "candidates": candidates})
    assert found == group_sentence(group)[:-1] + end


def test_a_group_says_every_member_that_is_clearly_likelier():
    """Two that are as likely as each other are both said: the headline says "or rather" of both."""
    group = [DELAY, GAIN, RATIO]
    candidates = [{**member, "probability": p} for member, p in zip(group, (0.08, 0.3, 0.3), strict=True)]
    document = {"explanation": [DELAY | {"probability": 0.08}], "candidates": candidates, "confounded": [group]}
    end = "; actuator gain (right) (0.30) and wheel radius mismatch (0.30) are likelier."
    assert group_sentence(group, document) == group_sentence(group)[:-1] + end
    assert or_else(document["explanation"][0], document) == (
        "or rather actuator gain of right or rather wheel radius mismatch"
    )


@pytest.mark.parametrize(
    ("group", "probabilities", "said"),
    [
        ([GAIN, RATIO], (0.4, 0.45), "or wheel radius mismatch"),
        ([RATIO, GAIN], (0.02, 0.76), "or rather wheel radius mismatch"),
        ([GAIN, [RATIO, DELAY]], (0.4, 0.45), "or wheel radius mismatch together with command delay"),
        ([GAIN, DELAY, RATIO], (0.1, 0.45), "or rather wheel radius mismatch or command delay"),
        ([GAIN, DELAY, RATIO, [RATIO, DELAY], [DELAY]], (0.4, 0.1), "or one of 4 other effects"),
        ([GAIN, GAIN | {"target": None}], (0.4, 0.45), "or actuator gain of all"),
        ([GAIN, RATIO], (0.95, 0.03), ""),  # hardly a doubt
        ([DELAY, RATIO], (0.4, 0.45), ""),  # in no group
    ],
)
def test_a_doubtful_effect_names_what_may_be_there_instead(group, probabilities, said):
    candidates = [{**member, "probability": p} for member, p in zip((GAIN, RATIO), probabilities, strict=True)]
    effect = GAIN | {"probability": probabilities[0]}
    assert or_else(effect, {"candidates": candidates, "confounded": [group]}) == said


def test_the_first_sentence_says_what_may_be_there_instead():
    doubtful = document("effects")
    doubtful["explanation"][0]["probability"] = 0.48
    assert " late (or sensor delay); adding this delay " in sentence(doubtful)


def test_what_is_left_in_words():
    assert plain(rest_sentence(document("unknown")["remainder"])) == (
        "The remaining error is mainly in elbow at low speed and depends on the angle of elbow (62 % of it, 12 times "
        "per revolution), consistent with motor cogging or gear teeth. Viscous friction of elbow would close 31 % of "
        "it, but the evidence was insufficient to name it."
    )
    nothing = plain(rest_sentence(document("partial")["remainder"]))
    assert "depends on no logged quantity; it comes in bursts: half of it occurs in 12 % of the time" in nothing
    rest = document("partial")["remainder"]
    rest |= {"half_within": 0.02, "times": [{"run": "r3", "from": 9.0, "to": 11.5, "share": 0.4}]}
    told = (
        "half of it occurs in 2 % of the time (most in r3 from 9 to 11.5 s). Was the robot pushed, held or lifted then?"
    )
    assert told in plain(rest_sentence(rest))


def test_an_error_of_the_time_step_is_said_to_be_one():
    rest = document("unknown")["remainder"] | {"own_step": True}
    assert plain(rest_sentence(rest)) == (
        "The remaining error is mainly in elbow at low speed. Most of it is the error of the model's own time step."
    )


def test_an_effect_that_closes_most_and_is_not_named_comes_with_the_reason():
    rest = document("unknown")["remainder"]
    why = "the search stopped before it."
    near = rest | {"resembles": {"effect": "command_delay", "target": None, "closes": 1.0, "why": why}}
    assert plain(rest_sentence(near)).endswith(
        "would close 100 % of it, but the evidence was insufficient to name it: the search stopped before it."
    )
    near["resembles"]["closes"] = 0.31
    assert rest_sentence(near).endswith("but the evidence was insufficient to name it.")
    assert "would close" not in rest_sentence(rest | {"resembles": None})


def test_a_curve_over_a_speed_is_one_sided_where_its_halves_differ():
    odd = {"kind": "turning", "curve": {"x": [-1.0, 0.0, 1.0], "y": [-0.5, 0.0, 0.5]}}
    weak = {"kind": "turning", "curve": {"x": [-1.0, 0.0, 1.0], "y": [0.0, 0.0, -0.5]}}
    assert not hint_of(odd) and "asymmetry" in hint_of(weak)


def test_a_slow_effect_is_quoted_over_the_horizon_that_shows_it() -> None:
    slow = document("effects")
    slow["shrink"]["value"] = 0.08
    ends = {"nominal": 0.06, "noise_floor": 0.005, "windows": 3, "held_out": False, "channels": {}, "window_gaps": {}}
    slow["gap"]["horizons"] = [
        {"horizon": 1.0, "before": 0.05, "after": 0.046, **ends},
        {"horizon": 30.0, "before": 0.06, "after": 0.006, **ends},
    ]
    said = sentence(slow).replace("\xa0", " ")
    assert "removes 8 % of the gap on held-out runs over 1 s, and 90 % over 30 s" in said
    slow["shrink"]["value"] = 0.6
    assert "over 30 s" not in sentence(slow)


def test_a_payload_beside_its_site_is_said_with_its_place() -> None:
    def metres(value: float) -> dict[str, object]:
        return {"value": value, "ci95": [value - 0.01, value + 0.01], "unit": "m"}

    mass = {"value": 0.5, "ci95": [0.4, 0.6], "unit": "kg"}
    at_site = {"effect": "payload", "target": None, "parameters": {"mass": mass}}
    assert plain(sentence_of(at_site)) == "the robot carries 0.5 kg more than modelled"
    beside = {**at_site, "parameters": {"mass": mass, "x": metres(0.08), "z": metres(-0.02)}}
    wanted = "the robot carries 0.5 kg more than modelled, 80 mm along x and -20 mm along z from the payload site"
    assert plain(sentence_of(beside)) == wanted


def test_a_loss_that_grows_with_the_load_is_said_per_unit_of_load() -> None:
    rubs: dict[str, Any] = {"effect": "load_dependent_friction", "target": "j1"}
    rubs["parameters"] = {"coefficient": {"value": 0.13, "unit": "1"}}
    assert plain(sentence_of(rubs)) == "friction in joint j1 takes 13 % of the transmitted torque"
    rubs["parameters"]["quadratic"] = {"value": 0.45, "unit": "1/(N m)"}
    assert plain(sentence_of(rubs)).endswith("of the transmitted torque, and 45 % more for each N m of it")


@pytest.mark.parametrize(
    ("values", "like"), [([0.0216, 0.0184], "a drifting heading"), ([0.05, -0.03], "wheels that do not grip alike")]
)
def test_a_yaw_rate_that_is_the_same_in_all_turns_is_no_slip(values: list[float], like: str):
    law = {"effect": "fitted_law", "target": "yaw", "of": "rate", "on": "the turning rate", "unit": "rad/s",
           "form": "curve", "values": values, "parameters": {}}  # fmt: skip
    assert like in law_sentence(law)


def test_a_rest_of_which_nothing_can_be_told_is_said_to_be_in_several_channels():
    remainder = document("partial")["remainder"]
    untold = remainder | {"components": [c | {"share": None} for c in remainder["components"]]}
    assert "mainly in several channels" in rest_sentence(untold)


@pytest.mark.parametrize(("target", "said"), [("elbow", "joint elbow"), ("joint2", "joint2"), ("Joint_3", "Joint_3")])
def test_a_joint_that_is_called_one_is_not_called_one_twice(target, said):
    assert BY_NAME["viscous_friction"].phrase.who(target, "joint") == said
    law = {"effect": "fitted_law", "target": target, "of": "torque", "on": "the position", "unit": "N m",
           "form": "curve", "values": [0.1, 0.2], "parameters": {}}  # fmt: skip
    assert f" acts at {said}" in law_sentence(law)
