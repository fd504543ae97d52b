"""The equivalents of an effect act on a simulated DC motor as the effect does on the model."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from residual_mpc.effects.servo.motor import Motor, mapped
from residual_mpc.effects.servo.readings import Driven, Reading, readings_of

VOLTAGE, RESISTANCE, KT, P_GAIN, DUTY = 7.4, 4.02, 0.387, 400.0, 0.0028774
INERTIA, DT = 0.01, 1e-4
MOTOR = Motor(VOLTAGE, RESISTANCE, KT, P_GAIN, DUTY)


def swing(
    voltage: float = VOLTAGE, resistance: float = RESISTANCE, kt: float = KT, factor: float = 1.0, load: float = 0.0,
    error: float | None = None, seconds: float = 0.6,
) -> np.ndarray:  # fmt: skip
    """(n, 2) angle and speed of a servo that is commanded to 0.3 rad, from the circuit's equations step by step.

    factor: on the torque, as an `actuator_gain` has it. load: N m. error: rad, held instead of the loop's own.
    """
    q = w = 0.0
    out = []
    for _ in range(round(seconds / DT)):
        duty = np.clip(P_GAIN * DUTY * (0.3 - q if error is None else error), -1.0, 1.0)
        current = (duty * voltage - kt * w) / resistance
        w += DT * (factor * kt * current - load) / INERTIA
        q += DT * w
        out.append((q, w))
    return np.array(out)


def effect(name: str, **parameters: tuple[float, float, float]) -> dict[str, Any]:
    numbers = {k: {"value": v, "ci95": [low, high]} for k, (v, low, high) in parameters.items()}
    return {"effect": name, "target": None, "parameters": numbers}


def read(entry: dict[str, Any], **changes: Any) -> dict[str, Reading]:
    driven = {"actuator": "s", "motor": MOTOR, "stiffness": MOTOR.stiffness} | changes
    return {r.quantity: r for r in readings_of(entry, (Driven(**driven),))}


def test_stall_torque_and_no_load_speed_are_those_of_the_circuit() -> None:
    first = swing(error=10.0, seconds=DT)
    assert first[0, 1] * INERTIA / DT == pytest.approx(MOTOR.stall_torque)
    assert swing(error=10.0, seconds=6.0)[-1, 1] == pytest.approx(MOTOR.no_load_speed, rel=1e-6)


def test_the_back_emf_brakes_as_a_damping_does() -> None:
    coasting = [2.0]
    for _ in range(1000):
        coasting.append(coasting[-1] - DT * MOTOR.damping * coasting[-1] / INERTIA)
    shorted = [2.0]
    for _ in range(1000):
        shorted.append(shorted[-1] + DT * KT * (0.0 - KT * shorted[-1]) / RESISTANCE / INERTIA)
    assert np.allclose(coasting, shorted, rtol=1e-12)


def test_the_stiffness_is_that_of_a_held_load() -> None:
    load = 0.1
    assert MOTOR.stiffness is not None
    assert 0.3 - swing(load=load, seconds=6.0)[-1, 0] == pytest.approx(load / MOTOR.stiffness, rel=1e-4)


@pytest.mark.parametrize("gain", [0.8, 1.3])
def test_a_gain_is_exactly_another_resistance(gain: float) -> None:
    reading = read(effect("actuator_gain", gain=(gain, gain, gain)))["resistance"]
    assert reading.value == pytest.approx(RESISTANCE / gain)
    assert np.allclose(swing(factor=gain), swing(resistance=reading.value), atol=1e-9)


def test_a_gain_is_another_supply_where_the_joint_stands() -> None:
    reading = read(effect("actuator_gain", gain=(0.82, 0.8, 0.84)))["supply_voltage"]
    assert reading.value == pytest.approx(0.82 * VOLTAGE) and reading.nominal == VOLTAGE
    assert reading.ci95 == pytest.approx((0.8 * VOLTAGE, 0.84 * VOLTAGE))
    held = [swing(load=0.1, seconds=6.0, **k)[-1, 0] for k in ({"factor": 0.82}, {"voltage": reading.value})]
    assert held[0] == pytest.approx(held[1], abs=1e-4)
    # in motion the back-EMF differs
    assert not np.allclose(swing(factor=0.82), swing(voltage=reading.value), atol=1e-3)


@pytest.mark.parametrize("gain", [0.8, 1.2])
def test_a_position_gain_is_exactly_another_supply(gain: float) -> None:
    """The duty cycle times the supply is the gain; the back-EMF, which damps, stays."""
    found = read(effect("position_gain", gain=(gain, gain, gain)))
    assert found.keys() == {"supply_voltage", "stiffness"} and MOTOR.stiffness is not None
    q = w = 0.0
    modelled = []
    for _ in range(round(0.6 / DT)):
        w += DT * (gain * MOTOR.stiffness * (0.3 - q) - MOTOR.damping * w) / INERTIA
        q += DT * w
        modelled.append((q, w))
    assert np.allclose(modelled, swing(voltage=found["supply_voltage"].value), atol=1e-9)
    assert found["stiffness"].value == pytest.approx(gain * MOTOR.stiffness)


def test_a_line_of_torque_over_speed_is_read_back_as_the_constants() -> None:
    other = Motor(6.0, 5.0, KT)
    line = {"stall_torque": (other.stall_torque,) * 3, "no_load_speed": (other.no_load_speed,) * 3}
    found = read(effect("torque_speed_limit", **line))
    assert found["supply_voltage"].value == pytest.approx(6.0) and found["resistance"].value == pytest.approx(5.0)
    geared = {"stall_torque": (other.stall_torque / 3,) * 3, "no_load_speed": (3 * other.no_load_speed,) * 3}
    behind = read(effect("torque_speed_limit", **geared), gear=3.0)
    assert behind["supply_voltage"].value == pytest.approx(6.0) and behind["resistance"].value == pytest.approx(5.0)


def test_a_saturation_is_a_limit_of_current_or_duty() -> None:
    found = read(effect("saturation", limit=(0.5 * MOTOR.stall_torque,) * 3))
    assert found["duty_limit"].value == pytest.approx(0.5)
    assert found["current_limit"].value * KT == pytest.approx(0.5 * MOTOR.stall_torque)


def test_a_sag_is_a_loss_of_volts_each_second() -> None:
    found = read(effect("voltage_sag", rate=(0.002, 0.001, 0.003)))["supply_loss"]
    assert (found.value, found.ci95) == (pytest.approx(0.0148), pytest.approx((0.0074, 0.0222)))


def test_no_supply_is_named_that_would_not_run_the_servo() -> None:
    assert read(effect("actuator_gain", gain=(0.03, 0.02, 0.04))).keys() == {"stiffness"}


def test_the_stiffness_is_compared_with_what_the_constants_give() -> None:
    """A model whose servo is far too stiff: what it acts like says the supply, and not the factor on that model."""
    assert MOTOR.stiffness is not None
    found = read(effect("actuator_gain", gain=(0.009, 0.008, 0.01)), stiffness=100.0 * MOTOR.stiffness)
    assert found["supply_voltage"].value == pytest.approx(0.9 * VOLTAGE)
    assert found["stiffness"].by_constants == pytest.approx(MOTOR.stiffness)


def test_actuators_share_a_reading_only_where_it_is_the_same() -> None:
    other = Motor(12.0, RESISTANCE, KT)
    driven = (Driven("a", MOTOR, 0.0), Driven("b", MOTOR, 0.0), Driven("c", other, 0.0))
    found = readings_of(effect("actuator_gain", gain=(0.9, 0.8, 1.0)), driven)
    supplies = {r.actuators: r.value for r in found if r.quantity == "supply_voltage"}
    assert supplies == {("a", "b"): pytest.approx(0.9 * VOLTAGE), ("c",): pytest.approx(10.8)}


def test_what_says_nothing_of_a_motor_has_no_reading() -> None:
    assert not read(effect("payload", mass=(0.1, 0.0, 0.2)))


def test_a_falling_law_turns_an_interval_round() -> None:
    assert mapped(lambda x: 1.0 / x, (2.0, (1.0, 4.0))) == (0.5, (0.25, 1.0))
    assert mapped(lambda x: 1.0 / x, (2.0, None)) == (0.5, None)


@pytest.mark.parametrize("constant", ["voltage", "resistance", "torque_constant", "p_gain", "duty_per_rad"])
def test_a_motor_has_positive_constants(constant: str) -> None:
    good = {"voltage": 7.4, "resistance": 4.0, "torque_constant": 0.4}
    with pytest.raises(ValueError, match="must be > 0"):
        Motor(**{**good, constant: 0.0})
