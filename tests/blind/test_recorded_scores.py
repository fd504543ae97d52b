"""When a comparison of recorded halves is right."""

import pytest

from residual_mpc.blind.recorded.score.claim import claim_of
from residual_mpc.blind.recorded.score.match import match
from residual_mpc.blind.recorded.score.outcome import Outcome, _sizes
from residual_mpc.blind.recorded.score.summary import summarise
from residual_mpc.blind.records import Answer, Planted

TARGETS = {
    "sensor_delay": ["elbow", "shoulder"], "payload": [], "sensor_bias": ["position.elbow", "position.shoulder"],
    "coulomb_friction": ["elbow", "shoulder"], "command_delay": ["m1", "m2"],
}  # fmt: skip


def truth(*effects, dose=3) -> Answer:
    planted = tuple(Planted(e, t, p) for e, t, p in effects)
    return Answer("c", "arm", "recorded", 1, planted, notes={"dose": [dose] * len(planted), "targets": TARGETS})


def said(verdict, *changes, groups=()):
    """changes: (effect, target, probability, {parameter: (value, low, high)})."""

    def part(effect, target, probability=0.9, sizes=None):
        figures = {k: {"change": {"value": v, "ci95": [low, high]}} for k, (v, low, high) in (sizes or {}).items()}
        return {"effect": effect, "target": target, "probability": probability, "parameters": figures}

    named = [[{"effect": e, "target": t} for e, t in group] for group in groups]
    return claim_of({"verdict": verdict, "changes": [part(*c) for c in changes], "confounded": named})


PAYLOAD = ("payload", None, {"mass": 0.2})
DELAY = ("command_delay", None, {"delay": 0.05})


def test_the_whole_set_is_right_and_anything_else_is_not():
    both = truth(PAYLOAD, DELAY)
    assert match(both, said("changed", ("payload", None), ("command_delay", None))).strict
    partial = match(both, said("partial", ("payload", None), ("command_delay", None)))
    assert partial.right and not partial.strict
    one = match(both, said("changed", ("payload", None)))
    assert not one.right and one.named == (True, False) and not one.wrong
    extra = match(truth(PAYLOAD), said("changed", ("payload", None), ("armature", "elbow")))
    assert not extra.right and extra.wrong == (("armature", "elbow"),)
    assert not match(both, said("same")).right


def test_a_group_may_stand_for_the_truth_but_not_strictly():
    group = [("sensor_delay", None), ("command_delay", None)]
    found = match(truth(DELAY), said("changed", ("sensor_delay", None), groups=[group]))
    assert found.right and not found.strict and found.named == (True,) and found.target_right
    assert not match(truth(DELAY), said("changed", ("sensor_delay", None))).right
    wide = [*group, ("actuator_lag", None), ("viscous_friction", None), ("armature", None)]
    assert not match(truth(DELAY), said("changed", ("sensor_delay", None), groups=[wide])).right


def test_nothing_changed_is_same():
    assert match(truth(), said("same")).strict
    assert not match(truth(), said("unknown")).right and not match(truth(), said("changed", ("payload", None))).right


@pytest.mark.parametrize("verdict", ["partial", "unknown"])
def test_an_effect_that_the_library_lacks_asks_for_doubt_without_a_wrong_name(verdict):
    lacking = truth(("rust", None, {"depth": 1.0}), PAYLOAD)
    assert match(lacking, said(verdict)).right
    assert match(lacking, said(verdict, ("payload", None))).right
    assert not match(lacking, said(verdict, ("armature", "elbow"))).right
    assert not match(lacking, said("changed", ("payload", None))).right and not match(lacking, said("same")).right


def test_targets_compare_with_all_and_with_channels():
    everywhere = truth(("sensor_delay", None, {"delay": 0.05}))
    assert match(everywhere, said("changed", ("sensor_delay", "elbow"), ("sensor_delay", "shoulder"))).target_right
    assert match(everywhere, said("changed", ("sensor_delay", "elbow"))).target_right is False
    bias = truth(("sensor_bias", "position.elbow", {"bias": 0.1}))
    assert match(bias, said("changed", ("sensor_bias", "elbow"))).target_right
    assert not match(bias, said("changed", ("sensor_bias", "shoulder"))).target_right


def test_sizes_count_from_no_change_and_intervals_are_not_clipped():
    answer = truth(("payload", None, {"mass": 0.2}), ("actuator_gain", "m1", {"gain": 0.8}))
    claim = said("changed", ("payload", None, 0.9, {"mass": (0.25, 0.21, 0.3)}),
                 ("actuator_gain", "m1", 0.9, {"gain": (0.9, 0.7, 1.1)}))  # fmt: skip
    mass, gain = _sizes(answer, claim)
    assert mass.relative_error == pytest.approx(0.25) and mass.covered is False
    assert gain.relative_error == pytest.approx(0.5) and gain.covered is True


def test_the_figures_of_a_method():
    def outcome(answer, claim):
        return Outcome("c", "arm", answer, claim, match(answer, claim), _sizes(answer, claim), 2.0, "")

    summary = summarise("m", [
        outcome(truth(PAYLOAD, dose=5), said("changed", ("payload", None, 0.9, {"mass": (0.21, 0.19, 0.23)}))),
        outcome(truth(PAYLOAD, dose=1), said("changed", ("coulomb_friction", "elbow", 0.93))),
        outcome(truth(DELAY, dose=1), said("partial", ("coulomb_friction", "elbow", 0.4))),
        outcome(truth(), said("same")),
    ])  # fmt: skip
    assert (summary.right.hits, summary.same_on_none.value, summary.interval_coverage.value) == (2, 1.0, 1.0)
    assert summary.surest_wrong == 0.93 and summary.sure_and_wrong.value == 0.5
    assert summary.by_dose["5"].value == 1.0 and summary.by_dose["1"].value == 0.0
    assert summary.by_kind["payload"].value == 0.5 and summary.by_number["none"].value == 1.0
    assert summary.size_error == pytest.approx(0.05)


def test_changes_are_counted_by_what_the_runs_were_said_to_show():
    """Of two missed changes one is smaller than the smallest that the comparison says its runs would show."""
    document = {"verdict": "same", "changes": [], "visible": [
        {"effect": "payload", "target": None, "parameters": {"mass": {"change": 0.1, "unit": "kg"}}},
        {"effect": "actuator_gain", "target": None, "parameters": {"gain": {"change": 0.3, "unit": "1"}}},
    ]}  # fmt: skip
    answer = truth(PAYLOAD, ("actuator_gain", "m1", {"gain": 0.9}), DELAY)
    claim = claim_of(document)
    missed = Outcome("a", "arm", answer, claim, match(answer, claim), (), None, "")
    assert missed.visible == (True, False, None)
    untouched = Outcome("b", "arm", truth(), claim, match(truth(), claim), (), None, "")
    both = summarise("x", [missed, untouched])
    assert both.right.hits == 1 and both.right_on_changed.hits == 0 and both.right_on_changed.count == 1
    table = both.by_visible
    assert {k: (r.hits, r.count) for k, r in table.items()} == {"above": (0, 1), "below": (0, 1)}
