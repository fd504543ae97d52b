"""Effects of a low probability are listed in one line, unless the answer rests on them."""

from __future__ import annotations

from typing import Any

from fabricated_diagnosis import document, evidence

from residual_mpc.report import compose, diagnosis_lines
from residual_mpc.report.words.servo import servo_lines
from residual_mpc.report.words.uncertain import by_certainty, told_groups

COMPLIANCE, LAG = ("joint_compliance", "j3"), ("sensor_lag", "j2")


def effect(name: str, target: str | None, probability: float, **values: float) -> dict[str, Any]:
    numbers = {k: {"value": v, "ci95": [0.5 * v, 1.5 * v], "unit": "1"} for k, v in values.items()}
    return {"effect": name, "target": target, "probability": probability, "parameters": numbers}


def group(*members: tuple[str, str | None]) -> list[dict[str, Any]]:
    return [{"effect": e, "target": t} for e, t in members]


def answer(**more: Any) -> dict[str, Any]:
    found = document("effects")
    found["explanation"] = [
        effect("coulomb_friction", "j3", 0.97, torque=0.3), effect("joint_compliance", "j3", 0.03, stiffness=1126.0)
    ]  # fmt: skip
    found["candidates"] = [
        {"effect": e, "target": t, "probability": p, "shrink": 0.1}
        for e, t, p in (("coulomb_friction", "j3", 0.97), (*COMPLIANCE, 0.03), (*LAG, 0.06))
    ]
    found["confounded"] = [group(COMPLIANCE, LAG)]
    return {**found, **more}


def test_an_uncertain_effect_is_listed_without_its_numbers_and_its_group() -> None:
    text = "\n".join(diagnosis_lines(answer()))
    assert "  too uncertain to name, but part of the model: joint compliance of j3 (probability 0.03)\n" in text + "\n"
    assert "1126" not in text and "cannot be told apart" not in text and "torque = 0.3" in text


def test_an_effect_that_the_sentence_names_is_shown() -> None:
    """At 0.12 it is named as possible; at any probability, if there is no other."""
    found = answer()
    found["explanation"][1]["probability"] = 0.12
    assert by_certainty(found)[1] == []
    found["explanation"] = [effect("joint_compliance", "j3", 0.03, stiffness=1126.0)]
    assert by_certainty(found)[1] == []


def test_an_effect_that_stands_for_a_likely_group_is_shown() -> None:
    found = answer()
    found["candidates"][2]["probability"] = 0.9
    shown, uncertain = by_certainty(found)
    assert len(shown) == 2 and not uncertain and told_groups(found, uncertain) == found["confounded"]


def test_a_group_with_another_named_member_is_told() -> None:
    found = answer(confounded=[group(COMPLIANCE, ("coulomb_friction", "j3"))])
    assert told_groups(found, by_certainty(found)[1]) == found["confounded"]


def test_the_page_folds_uncertain_effects_away() -> None:
    page = compose(answer(), evidence("effects"))
    causes = page[page.index('<section id="causes"') :]
    folded = causes[causes.index("<details><summary>Too uncertain to name") : causes.index("</details>")]
    assert "joint compliance of j3 (probability 0.03)" in folded and 'class="card doubtful"' in folded
    verdict = page[page.index('<section id="verdict"') : page.index("</section>")]
    assert "cannot be told apart" not in verdict and "stiffness" not in verdict


def test_a_servo_line_leaves_out_the_numbers_of_uncertain_effects_alone() -> None:
    def value(name: str, effects: list[str], probability: float) -> dict[str, Any]:
        return {"name": name, "unit": "N m", "nominal": 0.0, "value": 0.3, "ci95": None, "probability": probability,
                "status": "corrected", "effects": effects}  # fmt: skip

    servos = [
        {"actuator": name, "kind": "torque", "values": [value("dry_friction", ["coulomb_friction"], p)]}
        for name, p in (("m1", 0.97), ("m2", 0.03))
    ]
    document = {"servos": servos}
    assert len(servo_lines(document)) == 2
    (line,) = servo_lines(document, {"coulomb_friction"})
    assert line.startswith("motor m1: ")
