"""The change that follows from two diagnoses."""

from typing import Any

import pytest

from residual_mpc.blind.recorded.beside import difference
from residual_mpc.blind.recorded.score.claim import claim_of


def diagnosis(after: float, *effects: tuple[str, str | None, float, str, float, float]) -> dict[str, Any]:
    """(effect, target, probability, parameter, value, half width of its interval)"""
    return {
        "explanation": [
            {"effect": e, "target": t, "probability": p, "parameters": {k: {"value": v, "ci95": [v - h, v + h]}}}
            for e, t, p, k, v, h in effects
        ],
        "gap": {"after": after, "noise_floor": 0.01},
        "confounded": [],
    }


FRICTION = ("coulomb_friction", "elbow", 0.9, "torque", 0.10, 0.01)
GAIN = ("actuator_gain", "m2", 0.8, "gain", 0.9, 0.03)


def test_the_same_answers_are_no_change():
    assert difference(diagnosis(0.1, FRICTION), diagnosis(0.1, FRICTION)) | {"gap": {}} == {
        "verdict": "same", "changes": [], "confounded": [], "gap": {},
    }  # fmt: skip


def test_an_effect_that_only_the_changed_runs_have_is_a_change_of_its_size():
    claim = claim_of(difference(diagnosis(0.1, FRICTION), diagnosis(0.1, FRICTION, GAIN)))
    assert claim.verdict == "changed" and claim.named == (("actuator_gain", "m2"),)
    estimate = claim.estimates["actuator_gain", "m2"]["gain"]
    assert estimate.value == pytest.approx(0.9) and estimate.interval == pytest.approx((0.87, 0.93))


def test_an_effect_that_is_gone_is_the_opposite_change():
    claim = claim_of(difference(diagnosis(0.1, FRICTION, GAIN), diagnosis(0.1, GAIN)))
    assert claim.named == (("coulomb_friction", "elbow"),)
    assert claim.estimates["coulomb_friction", "elbow"]["torque"].value == pytest.approx(-0.10)


def test_a_number_has_changed_where_its_intervals_exclude_that_it_has_not():
    slightly = ("coulomb_friction", "elbow", 0.9, "torque", 0.112, 0.01)
    clearly = ("coulomb_friction", "elbow", 0.7, "torque", 0.12, 0.01)
    assert difference(diagnosis(0.1, FRICTION), diagnosis(0.1, slightly))["verdict"] == "same"
    (change,) = difference(diagnosis(0.1, FRICTION), diagnosis(0.1, clearly))["changes"]
    assert change["probability"] == 0.7 and change["parameters"]["torque"]["change"]["value"] == pytest.approx(0.02)


def test_more_left_than_of_the_untouched_runs_is_partial_or_unknown():
    assert difference(diagnosis(0.1), diagnosis(0.2))["verdict"] == "unknown"
    assert difference(diagnosis(0.1), diagnosis(0.2, GAIN))["verdict"] == "partial"


def test_a_gain_of_zero_has_no_ratio():
    dead = ("actuator_gain", "m2", 0.9, "gain", 0.0, 0.0)
    (change,) = difference(diagnosis(0.1, dead), diagnosis(0.1))["changes"]
    assert change["effect"] == "actuator_gain" and change["parameters"] == {}


def test_a_limit_that_only_one_names_has_no_size_of_change():
    limit = ("saturation", "left", 0.9, "limit", 4.0, 0.1)
    (change,) = difference(diagnosis(0.1), diagnosis(0.1, limit))["changes"]
    assert change["effect"] == "saturation" and change["parameters"] == {}
