"""What a report says of servos: equivalents as equivalents, and settings only where an effect concerns them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from fabricated_diagnosis import document
from oracles.arms import arm_xml

import residual_mpc as rm
from residual_mpc.api.servos import with_motors_changed, with_servos
from residual_mpc.report import Evidence
from residual_mpc.report.report import compose
from residual_mpc.report.terminal import diagnosis_lines
from residual_mpc.report.words.numbers import plain
from residual_mpc.report.words.servo import motor_lines, readings_sentence, servo_lines
from residual_mpc.report.words.summary import sentence

ACTUATORS = '<position name="s1" joint="j1" kp="30" kv="1.5"/><position name="s2" joint="j2" kp="30" kv="0.8"/>'
MOTOR = "[motor]\nvoltage = 7.4\nresistance = 4.0\ntorque_constant = 0.4\n"
Value = tuple[float, float, float]  # and its interval


def effect(name: str, target: str | None = None, unit: str = "1", **numbers: Value) -> dict[str, Any]:
    parameters = {k: {"value": v, "ci95": [low, high], "unit": unit} for k, (v, low, high) in numbers.items()}
    return {"effect": name, "target": target, "probability": 0.97, "parameters": parameters, "evidence": []}


def told(
    folder: Path, explanation: list[dict[str, Any]], motor: str = MOTOR, actuators: str = ACTUATORS
) -> dict[str, Any]:
    (folder / "arm.xml").write_text(arm_xml(actuators))
    (folder / "robot.toml").write_text(f'name = "arm"\nplant = "mujoco"\nmodel = "arm.xml"\n{motor}')
    made = {**document("effects"), "robot": "arm", "explanation": explanation, "model": {"values": []}}
    return with_servos(made, rm.load_robot(folder / "robot.toml"))


GAIN = effect("actuator_gain", gain=(0.82, 0.8, 0.84))


def test_a_gain_is_said_as_a_supply_or_a_resistance(tmp_path: Path) -> None:
    found = told(tmp_path, [GAIN], MOTOR + "p_gain = 16\n")
    said = plain(readings_sentence(found["explanation"][0]["motor"]))
    assert said == (
        "As if the supply were 6.07 V (5.92 to 6.22) rather than 7.4 V; or as if the motor's resistance were 4.88 ohm "
        "(4.76 to 5.00) rather than 4 ohm; a P gain of 16 acts like 24.6 N m/rad (24.0 to 25.2), where the model has "
        "30 N m/rad."
    )
    assert "(as if the supply were 6.07 V rather than 7.4 V, for example)" in plain(sentence(found))


def test_a_line_of_torque_over_speed_is_a_supply_and_a_resistance(tmp_path: Path) -> None:
    line = effect("torque_speed_limit", stall_torque=(0.5, 0.45, 0.55), no_load_speed=(15.0, 14.5, 15.5))
    line["parameters"]["stall_torque"]["unit"], line["parameters"]["no_load_speed"]["unit"] = "N m", "rad/s"
    found = told(tmp_path, [line])
    said = "as if the supply were 6 V rather than 7.4 V and as if the motor's resistance were 4.8 ohm rather than 4 ohm"
    assert said in plain(sentence(found))
    assert plain(readings_sentence(found["explanation"][0]["motor"])).startswith("As if the supply were 6.00 V (5.80 ")


def test_every_reading_stands_in_the_document_with_its_sentence(tmp_path: Path) -> None:
    found = json.loads(json.dumps(told(tmp_path, [GAIN])))
    supply = found["explanation"][0]["motor"][0]
    assert (supply["quantity"], supply["unit"], supply["nominal"]) == ("supply_voltage", "V", 7.4)
    assert supply["value"] == pytest.approx(6.068) and supply["ci95"] == pytest.approx([5.92, 6.216])
    assert supply["actuators"] == ["s1", "s2"] and supply["sentence"].startswith("as if the supply were")


def test_without_a_motor_nothing_is_said_of_one(tmp_path: Path) -> None:
    found = told(tmp_path, [GAIN], motor="")
    assert "motor" not in found["explanation"][0] and "supply" not in sentence(found)
    assert found["servos"] and found["servo_changes"][0]["setting"] == "P gain"  # what the servos are is known anyway


def test_a_fitted_law_has_no_reading(tmp_path: Path) -> None:
    law = {"effect": "fitted_law", "target": "j1", "probability": 0.9, "evidence": []}
    assert told(tmp_path, [law])["explanation"] == [law]


def test_the_settings_are_those_of_the_named_effects(tmp_path: Path) -> None:
    found = told(tmp_path, [
        GAIN, effect("sensor_bias", "position.j2", "rad", bias=(0.07, 0.06, 0.08)),
        effect("payload", unit="kg", mass=(0.1, 0.0, 0.2)),
    ], '[motor]\nservo = "sts3215"\np_gain = 16\n')  # fmt: skip
    changes = {c["setting"]: c for c in found["servo_changes"]}
    assert changes.keys() == {"P gain", "offset calibration"}
    assert changes["P gain"]["register"] == "P_Coefficient" and changes["P gain"]["actuators"] == ["s1", "s2"]
    assert plain(changes["P gain"]["sentence"]).startswith("19.5 in place of 16 would give the model's stiffness")
    assert changes["offset calibration"]["actuators"] == ["s2"]
    assert "-0.07 rad" in plain(changes["offset calibration"]["sentence"])


def test_a_servo_that_is_far_too_stiff_in_the_model_is_the_models_fault(tmp_path: Path) -> None:
    found = told(tmp_path, [effect("actuator_gain", gain=(0.02, 0.01, 0.03))])
    (change,) = found["servo_changes"]
    assert change["sentence"].endswith("correct the model, not the servo.")


def test_a_torque_driven_arm_has_no_settings(tmp_path: Path) -> None:
    motors = '<motor name="s1" joint="j1"/><motor name="s2" joint="j2"/>'
    found = told(tmp_path, [GAIN], "", motors)
    assert found["servo_changes"] == [] and {s["kind"] for s in found["servos"]} == {"torque"}


def test_the_page_has_the_table_and_the_settings(tmp_path: Path) -> None:
    found = told(tmp_path, [GAIN, effect("coulomb_friction", "j1", "N m", torque=(0.1, 0.05, 0.15))])
    page = compose(found, Evidence())
    table = page[page.index('<section id="servos"') : page.index('<section id="servo-changes"')]
    assert table.count('<th scope="row">') == 2 and "not shown" in table and "alike" in table
    assert "Not shown by these runs:" in table and "backlash" in table
    assert "What you can change on the servo" in page


def test_breaking_away_is_said_where_it_differs_from_sliding(tmp_path: Path) -> None:
    law = effect("stribeck_friction", "j1", "N m", static=(0.3, 0.2, 0.4), kinetic=(0.2, 0.1, 0.3))
    law["parameters"]["velocity"] = {"value": 0.1, "ci95": [0.0, 0.2], "unit": "rad/s"}
    both = told(tmp_path, [effect("coulomb_friction", None, "N m", torque=(0.1, 0.05, 0.15)), law])
    lines = diagnosis_lines(both)
    assert any("servo s1: " in line and "breakaway friction" in line for line in lines)
    assert not any("servo s2: " in line and "breakaway friction" in line for line in lines)


def test_a_terminal_says_once_what_is_alike(tmp_path: Path) -> None:
    found = told(tmp_path, [GAIN, effect("coulomb_friction", "j1", "N m", torque=(0.1, 0.05, 0.15))])
    servos = [line.strip() for line in diagnosis_lines(found) if line.startswith(("  servo ", "  all servos"))]
    assert servos == [
        "all servos alike: stiffness 30 N m/rad -> 24.6 N m/rad (24.0 to 25.2)",
        "servo s1: servo damping 1.5 N m s/rad -> 1.230 N m s/rad (1.200 to 1.260), dry friction 0 N m -> 0.10 N m "
        "(0.05 to 0.15)",
        "servo s2: servo damping 0.8 N m s/rad -> 0.656 N m s/rad (0.640 to 0.672)",
    ]


def test_a_torque_driven_joint_has_a_motor(tmp_path: Path) -> None:
    motors = '<motor name="m1" joint="j1"/><motor name="motor2" joint="j2"/>'
    friction = [
        effect("coulomb_friction", j, "N m", torque=(x, 0.05, 0.35)) for j, x in (("j1", 0.1), ("j2", 0.3))
    ]  # fmt: skip
    found = told(tmp_path, [GAIN, *friction], "", motors)
    lines = [line.strip() for line in diagnosis_lines(found)]
    assert [line.split(":")[0] for line in lines if "N m" in line and "->" in line] == ["motor m1", "motor2"]
    assert any(line.startswith("all motors alike: gain") for line in lines)
    page = compose(found, Evidence())
    assert "Motors</h2>" in page and "says of each motor" in page
    one = '<motor name="m1" joint="j1"/><position name="s2" joint="j2" kp="30" kv="0.8"/>'
    assert any(line.startswith("  actuator m1: ") for line in diagnosis_lines(told(tmp_path, [*friction], "", one)))


def test_the_page_leaves_out_what_concerns_no_servo() -> None:
    page = compose(document("effects"), Evidence())
    assert 'id="servos"' not in page and 'id="servo-changes"' not in page


def test_a_changed_gain_is_said_as_another_supply(tmp_path: Path) -> None:
    """Relative to the runs before, whatever the model's own stiffness is."""
    (tmp_path / "arm.xml").write_text(arm_xml(ACTUATORS))
    (tmp_path / "robot.toml").write_text(f'name = "arm"\nplant = "mujoco"\nmodel = "arm.xml"\n{MOTOR}p_gain = 16\n')
    size = {"before": 0.9, "after": 0.738, "change": {"value": 0.82, "ci95": [0.8, 0.84], "unit": "1"}}
    changes = [
        {"effect": "actuator_gain", "target": None, "probability": 0.9, "parameters": {"gain": size}},
        {"effect": "payload", "target": None, "probability": 0.9, "parameters": {"mass": {**size, "before": 0.0}}},
    ]
    gain, payload = with_motors_changed({"changes": changes}, rm.load_robot(tmp_path / "robot.toml"))["changes"]
    assert motor_lines(payload) == [] and "motor" not in payload
    (line,) = motor_lines(gain)
    assert plain(line) == (
        "As if the supply were 6.07 V (5.92 to 6.22) rather than 7.4 V; or as if the motor's resistance were 4.88 ohm "
        "(4.76 to 5.00) rather than 4 ohm"
    )


@pytest.mark.parametrize(("probability", "doubted"), [(0.49, True), (0.5, False), (None, False)])
def test_a_number_of_an_effect_that_is_less_likely_than_not_is_only_possible(
    probability: float | None, doubted: bool
) -> None:
    number = {"name": "dry_friction", "unit": "N m", "nominal": 0.0, "value": 0.03, "ci95": [0.02, 0.04],
              "probability": probability, "status": "corrected" if probability is not None else "retuned"}  # fmt: skip
    (line,) = servo_lines({"servos": [{"actuator": "servo", "values": [number]}]})
    assert line.startswith("servo: possibly dry friction" if doubted else "servo: dry friction")
