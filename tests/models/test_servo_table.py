"""A row for each servo: what holds for all joints alike stands in each, and what was not found says so."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from oracles.arms import arm_xml

import residual_mpc as rm
from residual_mpc.effects.servo.changes import advice_on
from residual_mpc.models.servo_table import ServoRow, ServoValue, servo_rows

ACTUATORS = (
    '<position name="s1" joint="j1" kp="30" kv="1.5"/><position name="s2" joint="j2" kp="20" kv="0.8" gear="2"/>'
)
ROBOT = 'name = "arm"\nplant = "mujoco"\nmodel = "arm.xml"\n[motor]\nservo = "sts3215"\n'
Value = tuple[float, float, float]  # and its interval


def entry(name: str, target: str | None, probability: float = 0.9, **numbers: Value) -> dict[str, Any]:
    parameters = {k: {"value": v, "ci95": [low, high], "unit": "1"} for k, (v, low, high) in numbers.items()}
    return {"effect": name, "target": target, "probability": probability, "parameters": parameters}


def rows(
    folder: Path, explanation: list[dict[str, Any]], actuators: str = ACTUATORS, **more: Any
) -> dict[str, ServoRow]:
    (folder / "arm.xml").write_text(arm_xml(actuators))
    (folder / "robot.toml").write_text(ROBOT)
    robot = rm.load_robot(folder / "robot.toml")
    document = {"explanation": explanation, "model": {"values": []}} | more
    return {row.actuator: row for row in servo_rows(document, robot.model, robot.file)}


def value(row: ServoRow, name: str) -> ServoValue:
    return next(v for v in row.values if v.name == name)


def test_what_holds_for_all_alike_stands_in_every_row(tmp_path: Path) -> None:
    found = rows(tmp_path, [entry("coulomb_friction", None, torque=(0.1, 0.05, 0.15))])
    first, second = (value(found[s], "dry_friction") for s in ("s1", "s2"))
    assert (first.nominal, first.value, first.ci95) == (0.0, 0.1, pytest.approx((0.05, 0.15)))
    assert (second.nominal, second.value) == (pytest.approx(0.02), pytest.approx(0.12))  # the model has some already
    assert first.alike and second.alike and first.probability == 0.9


@pytest.mark.parametrize(("delay", "expected", "advised"), [(0.02, 0.02, 1), (-0.009, 0.0, 0)])
def test_commands_that_act_before_their_stamps_are_no_servos(
    tmp_path: Path, delay: float, expected: float, advised: int
) -> None:
    found = rows(tmp_path, [entry("command_delay", None, delay=(delay, delay - 0.001, delay + 0.001))])
    assert value(found["s1"], "delay").value == expected
    assert len(advice_on("command_delay", {"delay": delay}, 30.0, None)) == advised


def test_a_joints_own_value_replaces_that_of_all(tmp_path: Path) -> None:
    both = [entry("actuator_gain", None, gain=(0.8, 0.7, 0.9)), entry("actuator_gain", "s2", 0.6, gain=(0.5, 0.4, 0.6))]
    found = rows(tmp_path, both)
    first, second = (value(found[s], "stiffness") for s in ("s1", "s2"))
    assert (first.nominal, first.value, first.ci95) == (30.0, 24.0, pytest.approx((21.0, 27.0))) and first.alike
    assert (second.nominal, second.value, second.probability) == (80.0, 40.0, 0.6)  # gear 2: 20 * 2^2
    assert not second.alike
    damping = value(found["s1"], "damping")
    assert (damping.nominal, damping.value) == (1.5, pytest.approx(1.2))


def test_an_effect_of_a_joint_or_a_channel_is_the_servos(tmp_path: Path) -> None:
    found = rows(tmp_path, [
        entry("armature", "j2", inertia=(0.01, 0.0, 0.02)), entry("backlash", "j1", gap=(0.02, 0.01, 0.03)),
        entry("sensor_bias", "position.j1", bias=(0.07, 0.06, 0.08)), entry("saturation", "s2", limit=(1.5, 1.0, 2.0)),
    ])  # fmt: skip
    assert value(found["s2"], "rotor_inertia").value == pytest.approx(0.015)
    assert value(found["s1"], "backlash").value == 0.02 and value(found["s2"], "backlash").status == "not named"
    assert value(found["s1"], "offset").value == 0.07 and value(found["s2"], "offset").value == 0.0
    assert value(found["s2"], "torque_limit").value == 3.0  # at the joint, behind a gear of 2
    assert value(found["s1"], "torque_limit").nominal is None


@pytest.mark.parametrize("limit", [1.5, 9.0])
def test_a_limit_replaces_that_of_the_model(tmp_path: Path, limit: float) -> None:
    """Lower or higher than the model's 4 N m, behind a gear of 2."""
    limited = ACTUATORS.replace('gear="2"', 'gear="2" forcerange="-2 2"')
    found = rows(tmp_path, [entry("saturation", "s2", limit=(limit, 0.9 * limit, 1.1 * limit))], limited)
    torque = value(found["s2"], "torque_limit")
    assert (torque.nominal, torque.value) == (pytest.approx(4.0), pytest.approx(2.0 * limit))


def test_effects_on_one_number_add_up(tmp_path: Path) -> None:
    found = rows(tmp_path, [
        entry("coulomb_friction", "j1", 0.9, torque=(0.1, 0.07, 0.13)),
        entry(
            "stribeck_friction", "j1", 0.7,
            static=(0.3, 0.2, 0.4), kinetic=(0.2, 0.16, 0.24), velocity=(0.1, 0.0, 0.2),
        ),
    ])  # fmt: skip
    dry = value(found["s1"], "dry_friction")
    assert dry.value == pytest.approx(0.3) and dry.ci95 == pytest.approx((0.25, 0.35))  # 0.03 and 0.04, independent
    assert dry.probability == 0.7
    assert value(found["s1"], "breakaway_friction").value == pytest.approx(0.4)  # 0.1 of the one, 0.3 of the other


def test_a_friction_below_zero_comes_off_the_servos_damping(tmp_path: Path) -> None:
    """A P gain of 1.2 with the damping unchanged; the joint's own damping is 0.1 N m s/rad."""
    gain = entry("actuator_gain", "s1", gain=(1.2, 1.1, 1.3))
    friction = entry("viscous_friction", "j1", 0.6, coefficient=(-0.4, -0.48, -0.3))
    row = rows(tmp_path, [gain, friction])["s1"]
    servo, joint = value(row, "damping"), value(row, "viscous_friction")
    assert value(row, "stiffness").value == pytest.approx(36.0)
    assert (servo.nominal, servo.value) == (1.5, pytest.approx(1.2 * 1.5 - 0.3))
    assert servo.ci95 == pytest.approx((1.5 - np.hypot(0.15, 0.08), 1.5 + np.hypot(0.15, 0.1)))
    assert (servo.probability, servo.effects) == (0.6, ("actuator_gain", "viscous_friction"))
    assert (joint.value, joint.ci95) == (0.0, (0.0, 0.0))
    alone = rows(tmp_path, [friction])["s1"]
    assert value(alone, "damping").value == pytest.approx(1.2) and value(alone, "damping").probability == 0.6
    kept = rows(tmp_path, [entry("viscous_friction", "j1", coefficient=(-0.05, -0.2, 0.1))])["s1"]
    assert (value(kept, "damping").value, value(kept, "damping").effects) == (1.5, ())


def test_a_position_gain_is_a_stiffness_without_damping(tmp_path: Path) -> None:
    """Beside a gain of the whole servo, both scale the stiffness, and the gain alone the damping."""
    stiffer = entry("position_gain", "s1", 0.7, gain=(1.5, 1.4, 1.6))
    row = rows(tmp_path, [stiffer])["s1"]
    assert (value(row, "stiffness").value, value(row, "stiffness").probability) == (pytest.approx(45.0), 0.7)
    assert (value(row, "damping").value, value(row, "damping").effects) == (1.5, ())
    both = rows(tmp_path, [stiffer, entry("actuator_gain", "s1", gain=(0.8, 0.75, 0.85))])["s1"]
    assert value(both, "stiffness").value == pytest.approx(36.0) and value(both, "damping").value == pytest.approx(1.2)
    (advice,) = advice_on("position_gain", {"gain": 1.25}, 30.0, 32.0)
    assert advice.numbers["wanted"] == (pytest.approx(25.6), "1")


def test_what_the_runs_do_not_show_is_said(tmp_path: Path) -> None:
    found = rows(
        tmp_path, [], candidates=[{"effect": "armature", "target": None, "probability": 0.04}],
        not_testable=[{"effect": "voltage_sag", "target": None, "why": "no run is long"},
                      {"effect": "backlash", "target": "j2", "why": "it hardly reverses"}],
    )  # fmt: skip
    inertia = value(found["s1"], "rotor_inertia")
    assert (inertia.status, inertia.value, inertia.ci95, inertia.probability) == ("not named", 0.01, None, 0.04)
    sag = value(found["s2"], "gain_loss")
    assert (sag.status, sag.why) == ("not testable", "no run is long")
    assert [value(found[s], "backlash").status for s in ("s1", "s2")] == ["not named", "not testable"]


def test_a_number_without_a_bound_is_the_models(tmp_path: Path) -> None:
    line = entry("torque_speed_limit", None, stall_torque=(2.0, 1.9, 2.1))
    line["parameters"]["no_load_speed"] = {"value": None, "ci95": [None, None], "unit": "rad/s"}
    found = rows(tmp_path, [line])
    assert value(found["s1"], "torque_limit").value == 2.0 and value(found["s1"], "no_load_speed").value is None


def test_the_motors_constants_stand_beside_the_models_numbers(tmp_path: Path) -> None:
    first = rows(tmp_path, [])["s1"]
    assert first.motor is not None
    given = {v.name: v.by_constants for v in first.values if v.by_constants is not None}
    assert given == {
        "damping": first.motor.damping, "torque_limit": first.motor.stall_torque,
        "no_load_speed": first.motor.no_load_speed,
    }  # without its P register the stiffness is not known  # fmt: skip


def test_a_retuned_number_is_told_from_the_models(tmp_path: Path) -> None:
    tuned = {"effect": "tune", "target": None, "parameter": "joint.j1.damping", "value": 0.3}
    found = rows(tmp_path, [], model={"values": [tuned]})
    damping = value(found["s1"], "viscous_friction")
    assert (damping.status, damping.nominal, damping.value) == ("retuned", 0.1, 0.3)


def test_what_cannot_be_told_apart_is_noted(tmp_path: Path) -> None:
    group = [{"effect": "actuator_gain", "target": None}, {"effect": "saturation", "target": None}]
    found = rows(tmp_path, [entry("actuator_gain", None, gain=(0.8, 0.7, 0.9))], confounded=[group])
    assert value(found["s1"], "stiffness").notes == ("or saturation",)


def test_a_differential_drive_has_no_servos() -> None:
    robot = rm.load_robot("diff_drive")
    assert servo_rows({"explanation": [], "model": {"values": []}}, robot.model, robot.file) == ()
