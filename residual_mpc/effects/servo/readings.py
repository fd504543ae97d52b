"""A diagnosed effect as what it would be on a motor of known constants: each reading is an equivalent, not a cause.

Where several constants could have changed, each stands as a reading of its own, with the others as the user states
them.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from residual_mpc.effects.actuator import ACTUATOR_GAIN, SATURATION, TORQUE_SPEED_LIMIT, VOLTAGE_SAG
from residual_mpc.effects.body import VISCOUS
from residual_mpc.effects.position_servo import POSITION_GAIN
from residual_mpc.effects.servo.motor import Across, Motor, mapped

SUPPLY = (0.5, 1.5)  # of the stated voltage: further off the servo would not run, or not for long
RESISTANCE = (0.5, 2.0)  # of the stated one: copper that is 100 K hotter has 1.39 times the resistance


@dataclass(frozen=True)
class Driven:
    """What the nominal model says of one actuator, at its joint.

    actuator: its name. motor: its constants. stiffness: N m/rad of a position servo, else 0. gear: torque at the joint
    per unit of the actuator's. damping: N m s/rad, of servo and joint together; corrected: the same with a gain of the
    servo that is named, which scales the servo's part of it.
    """

    actuator: str
    motor: Motor
    stiffness: float
    gear: float = 1.0
    damping: float = 0.0
    corrected: float = 0.0


@dataclass(frozen=True)
class Reading:
    """One equivalent.

    Attributes:
        actuators: that it holds for.
        quantity: "supply_voltage", "supply_loss", "resistance", "stiffness", "current_limit", "duty_limit" or
            "back_emf_damping".
        value: in `unit`, with its 95 % interval where the effect's parameter has one.
        nominal: what it is in comparison to: the constant that the robot file states, or the model's own value.
        p_gain: of the servo's register, where the reading is about it.
        by_constants: the same quantity as the motor's constants alone give it, where they do.
        jointly: it holds together with the other readings of the effect, where others are alternatives to each other.
    """

    actuators: tuple[str, ...]
    quantity: str
    value: float
    ci95: tuple[float, float] | None
    unit: str
    nominal: float
    p_gain: float | None = None
    by_constants: float | None = None
    jointly: bool = False


def readings_of(effect: Mapping[str, Any], driven: Sequence[Driven]) -> tuple[Reading, ...]:
    """The readings of an entry of an explanation. driven: the actuators that it acts on.

    Actuators for which a reading is the same share it. Effects that say nothing of a motor have none.
    """
    law = LAWS.get(effect["effect"])
    if law is None or any(p["value"] is None for p in effect["parameters"].values()):  # null: without a bound
        return ()
    shared: dict[Reading, list[str]] = {}
    for one in driven:
        for reading in law(_parameters(effect), one):
            shared.setdefault(replace(reading, actuators=()), []).append(one.actuator)
    return tuple(replace(reading, actuators=tuple(actuators)) for reading, actuators in shared.items())


def _whole_gain(p: Mapping[str, Across], d: Driven) -> list[Reading]:
    """Times g is a supply of g V, or a resistance of R / g (which scales the back-EMF's damping as well). Where the
    firmware's law is known, the stiffness is compared with what the constants give, and not with the model's."""
    m, share = d.motor, _share_of_constants(p, d)
    out = _supply(share, d)
    if RESISTANCE[0] <= 1.0 / max(share[0], 1e-9) <= RESISTANCE[1] and _positive(share):
        out.append(_reading(d, "resistance", mapped(lambda g: m.resistance / g, share), "ohm", m.resistance))
    return out + _stiffness(p, d)


def _position_gain(p: Mapping[str, Across], d: Driven) -> list[Reading]:
    """Times g is a supply of g V: the back-EMF, which damps, stays. See `_whole_gain`."""
    return _supply(_share_of_constants(p, d), d) + _stiffness(p, d)


def _share_of_constants(p: Mapping[str, Across], d: Driven) -> Across:
    """The gain, relative to what the motor's constants give where these say it, else to the model."""
    if d.motor.stiffness is None or d.stiffness <= 0.0:
        return p["gain"]
    by_constants = d.motor.stiffness
    return mapped(lambda g: g * d.stiffness / by_constants, p["gain"])


def _supply(share: Across, d: Driven) -> list[Reading]:
    volts = d.motor.voltage
    if not SUPPLY[0] <= share[0] <= SUPPLY[1]:
        return []
    return [_reading(d, "supply_voltage", mapped(lambda g: g * volts, share), "V", volts)]


def _stiffness(p: Mapping[str, Across], d: Driven) -> list[Reading]:
    m = d.motor
    if d.stiffness <= 0.0:
        return []
    stiffness = mapped(lambda g: g * d.stiffness, p["gain"])
    return [_reading(d, "stiffness", stiffness, "N m/rad", d.stiffness, m.p_gain, m.stiffness)]


def _sag(p: Mapping[str, Across], d: Driven) -> list[Reading]:
    """A gain that falls by the rate is a supply that falls by rate V each second."""
    volts = mapped(lambda rate: rate * d.motor.voltage, p["rate"])
    return [_reading(d, "supply_loss", volts, "V/s", d.motor.voltage)]


def _line(p: Mapping[str, Across], d: Driven) -> list[Reading]:
    """The line of a motor: V = no_load kt, then R = kt V / stall."""
    kt, gear = d.motor.torque_constant, abs(d.gear)
    volts = mapped(lambda w: w / gear * kt, p["no_load_speed"])
    ohms = mapped(lambda stall, w: kt * kt * (w / gear) / (stall * gear), p["stall_torque"], p["no_load_speed"])
    both = [
        _reading(d, "supply_voltage", volts, "V", d.motor.voltage),
        _reading(d, "resistance", ohms, "ohm", d.motor.resistance),
    ]
    return [replace(reading, jointly=True) for reading in both]


def _saturation(p: Mapping[str, Across], d: Driven) -> list[Reading]:
    """A torque limit L is a current limit of L / kt, or a limit of the duty cycle to L of the stall torque."""
    m, torque = d.motor, mapped(lambda limit: limit * abs(d.gear), p["limit"])
    amperes = mapped(lambda x: x / m.torque_constant, torque)
    out = [_reading(d, "current_limit", amperes, "A", m.voltage / m.resistance)]
    if torque[0] < m.stall_torque:
        out.append(_reading(d, "duty_limit", mapped(lambda x: x / m.stall_torque, torque), "1", 1.0))
    return out


def _viscous(p: Mapping[str, Across], d: Driven) -> list[Reading]:
    """Friction beside what damps already, for comparison with what the back-EMF gives, kt^2 / R."""
    value = mapped(lambda c: d.corrected + c, p["coefficient"])
    return [_reading(d, "back_emf_damping", value, "N m s/rad", d.damping, None, d.motor.damping)]


Law = Callable[[Mapping[str, Across], Driven], list[Reading]]
LAWS: Mapping[str, Law] = {
    ACTUATOR_GAIN.name: _whole_gain,
    POSITION_GAIN.name: _position_gain,
    VOLTAGE_SAG.name: _sag,
    TORQUE_SPEED_LIMIT.name: _line,
    SATURATION.name: _saturation,
    VISCOUS.name: _viscous,
}


def _reading(
    d: Driven, quantity: str, number: Across, unit: str, nominal: float, p_gain: float | None = None,
    by_constants: float | None = None,
) -> Reading:  # fmt: skip
    return Reading((d.actuator,), quantity, *number, unit, nominal, p_gain, by_constants)


def _positive(number: Across) -> bool:
    return number[0] > 0.0 and (number[1] is None or number[1][0] > 0.0)


def _parameters(effect: Mapping[str, Any]) -> dict[str, Across]:
    out: dict[str, Across] = {}
    for name, p in effect["parameters"].items():
        low, high = p.get("ci95") or (None, None)
        out[name] = (float(p["value"]), None if low is None or high is None else (float(low), float(high)))
    return out
