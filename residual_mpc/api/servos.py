"""A diagnosis with what it says of the robot's servos: a row each, motors' readings of effects, what can be changed;
and a comparison with motors' readings of its changes."""

from collections.abc import Sequence
from dataclasses import asdict, replace
from typing import Any

from residual_mpc.api.robot import NominalRobot
from residual_mpc.effects.actuator import ACTUATOR_GAIN
from residual_mpc.effects.position_servo import POSITION_GAIN
from residual_mpc.effects.servo.readings import Driven, readings_of
from residual_mpc.models.motors.tables import servo_of
from residual_mpc.models.servo_table import ServoRow, driven_by, servo_rows
from residual_mpc.report.words.servo import changes, reading_clause

GAINS = (ACTUATOR_GAIN.name, POSITION_GAIN.name)  # changes that say something of a motor


def with_servos(document: dict[str, Any], robot: NominalRobot) -> dict[str, Any]:
    """The document with `servos`, `servo_changes` and, for effects that say something of a known motor, `motor`."""
    rows = servo_rows(document, robot.model, robot.file)
    out = {
        **document,
        "explanation": [_with_motor(effect, document, robot, rows) for effect in document["explanation"]],
        "servos": [row.document() for row in rows],
    }
    motors = {row.actuator: row.motor for row in rows if row.motor is not None}
    registers = {a: servo.registers for a, motor in motors.items() if (servo := servo_of(motor)) is not None}
    return {**out, "servo_changes": changes(out, registers)}


def _with_motor(
    effect: dict[str, Any], document: dict[str, Any], robot: NominalRobot, rows: Sequence[ServoRow]
) -> dict[str, Any]:
    if "parameters" not in effect:
        return effect
    single = [e["target"] for e in document["explanation"] if e["effect"] == effect["effect"] and e["target"]]
    driven = driven_by(effect["effect"], effect["target"], robot.model, rows, single)
    readings = [asdict(reading) for reading in readings_of(effect, driven)]
    return {**effect, "motor": [{**r, "sentence": reading_clause(r)} for r in readings]} if readings else effect


def with_motors_changed(document: dict[str, Any], robot: NominalRobot) -> dict[str, Any]:
    """A comparison with `motor` in changes that say something of a known motor. Readings are relative to the runs
    before, which count as having the constants of the robot file."""
    rows = servo_rows({"values": []}, robot.model, robot.file)
    return {**document, "changes": [_with_motor_changed(change, robot, rows) for change in document["changes"]]}


def _with_motor_changed(change: dict[str, Any], robot: NominalRobot, rows: Sequence[ServoRow]) -> dict[str, Any]:
    if change["effect"] not in GAINS:
        return change
    driven = [_relative(d) for d in driven_by(change["effect"], change["target"], robot.model, rows)]
    sizes = {name: n["change"] for name, n in change["parameters"].items()}
    readings = [asdict(reading) for reading in readings_of({**change, "parameters": sizes}, driven)]
    return {**change, "motor": [{**r, "sentence": reading_clause(r)} for r in readings]} if readings else change


def _relative(driven: Driven) -> Driven:
    """Without what is compared with the nominal model rather than with the runs before."""
    return replace(driven, stiffness=0.0)
