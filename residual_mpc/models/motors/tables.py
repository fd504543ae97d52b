"""The tables [motor] and [motor.ACTUATOR] of a robot file."""

from collections.abc import Mapping, Sequence

from residual_mpc.effects.servo.motor import Motor
from residual_mpc.errors import BadInput
from residual_mpc.logs.columns import did_you_mean
from residual_mpc.models.motors.published import SERVOS, Servo

NEEDED = ("voltage", "resistance", "torque_constant")
NUMBERS = (*NEEDED, "p_gain", "duty_per_rad")
UNITS = {"voltage": "V", "resistance": "ohm", "torque_constant": "N m/A at the joint"}

# (actuator, key) -> value; the actuator is empty for what holds for all. Flat, so that a variant overrides one entry.
Entries = Mapping[tuple[str, str], float | str]


def read_motors(table: Mapping[str, object], where: str) -> dict[tuple[str, str], float | str]:
    """The entries of [motor] and its sub-tables, checked one by one.

    Raises:
        BadInput: an unknown key or servo, or a number that is not positive.
    """
    out: dict[tuple[str, str], float | str] = {}
    for key, value in table.items():
        if isinstance(value, Mapping):
            place = f"{where}, [motor.{key}]"
            out |= {(key, inner): _entry(inner, item, place) for inner, item in value.items()}
        else:
            out["", key] = _entry(key, value, f"{where}, [motor]")
    return out


def check_motors(entries: Entries, where: str) -> None:
    """Raises BadInput for a motor that lacks a constant."""
    named = {actuator for actuator, _ in entries if actuator}
    for actuator in sorted(named) or [""] * bool(entries):
        missing = [key for key in NEEDED if key not in _merged(entries, actuator)]
        if missing:
            place = f"[motor.{actuator}]" if actuator else "[motor]"
            raise BadInput(
                f"{' and '.join(missing)} {'is' if len(missing) == 1 else 'are'} missing",
                f"{where}, {place}",
                f'add {", ".join(f"{key} ({UNITS[key]})" for key in missing)}, or name a servo: servo = "sts3215"',
            )


def check_names(entries: Entries, actuators: Sequence[str], where: str) -> None:
    """Raises BadInput for a table of an actuator that the model does not have."""
    for actuator in dict.fromkeys(a for a, _ in entries if a):
        if actuator not in actuators:
            near = did_you_mean(actuator, list(actuators))
            raise BadInput(
                f"the model has no actuator {actuator!r}", f"{where}, [motor.{actuator}]",
                f"{near}; its actuators are {', '.join(actuators)}",
            )  # fmt: skip


def motor_of(entries: Entries, actuator: str) -> Motor | None:
    """The motor of an actuator: its own entries first, then those for all, then the figures of the servo named."""
    found = _merged(entries, actuator)
    if any(key not in found for key in NEEDED):
        return None
    numbers = {key: float(found[key]) for key in NUMBERS if key in found}
    return Motor(**numbers, servo=str(found.get("servo", "")))


def servo_of(motor: Motor) -> Servo | None:
    """What is published of it."""
    return SERVOS.get(motor.servo)


def _merged(entries: Entries, actuator: str) -> dict[str, float | str]:
    common = {key: value for (a, key), value in entries.items() if a == ""}
    own = {key: value for (a, key), value in entries.items() if a == actuator}
    given = {**common, **own}
    if "servo" in own:  # another servo than the others': their constants are not its own
        given = {**{k: v for k, v in common.items() if k in ("voltage", "p_gain")}, **own}
    servo = SERVOS.get(str(given.get("servo", "")))
    if servo is None:
        return given
    figures: dict[str, float | str | None] = {
        "voltage": servo.voltage, "resistance": servo.resistance, "torque_constant": servo.torque_constant,
        "duty_per_rad": servo.duty_per_rad,
    }  # fmt: skip
    return {k: v for k, v in figures.items() if v is not None} | given


def _entry(key: str, value: object, where: str) -> float | str:
    if key == "servo":
        if not isinstance(value, str) or value.lower() not in SERVOS:
            near = did_you_mean(value.lower(), list(SERVOS)) if isinstance(value, str) else "give a name in quotes"
            raise BadInput(
                f"unknown servo {value!r}", where,
                f"{near}; known servos: {', '.join(SERVOS)}; for any other state {', '.join(NEEDED)}",
            )  # fmt: skip
        return value.lower()
    if key not in NUMBERS:
        raise BadInput(f"unknown key {key!r}", where, did_you_mean(key, ["servo", *NUMBERS]))
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 < value < 1e300:
        raise BadInput(f"{key} must be a number > 0, got {value!r}", where, _unit_remedy(key))
    return float(value)


def _unit_remedy(key: str) -> str:
    return f"give it in {UNITS[key]}" if key in UNITS else ""
