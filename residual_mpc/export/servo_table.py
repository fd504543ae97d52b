"""The table of servos as CSV: one file with a row a servo, one with a row a number."""

import csv
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from residual_mpc.effects.servo.numbers import NUMBERS
from residual_mpc.errors import BadInput
from residual_mpc.export.augmented import settings_from
from residual_mpc.files import write_atomically
from residual_mpc.models.model_file import Written, model_content
from residual_mpc.models.protocol import Robot
from residual_mpc.models.robot_file import RobotFile
from residual_mpc.models.servo_table import NOT_NAMED, NOT_TESTABLE, ServoRow, ServoValue, servo_rows

TABLE, NUMBERS_FILE = "servos.csv", "servo_numbers.csv"
SHOWN = {NOT_NAMED: "not shown by these runs", NOT_TESTABLE: "not shown by these runs: "}
CONSTANTS = ("voltage", "resistance", "torque_constant", "p_gain", "duty_per_rad")


def write_servo_table(
    written: Written, found: Mapping[str, Any] | None, robot: Robot, file: RobotFile, folder: Path
) -> dict[str, Any]:
    """Write a row for each servo and describe the files.

    Args:
        found: content of the diagnosis.json, for intervals, probabilities and what could not be tested; None of a
            model.json.

    Raises:
        BadInput: a model of another robot, or a robot without actuators of its own, such as a differential drive.
    """
    settings_from(written, robot)
    rows = servo_rows(model_content(written) if found is None else found, robot, file)
    if not rows:
        raise BadInput(f"{robot.name!r} has no table of actuators", "--to servo-table", "export to casadi, c or jax")
    folder.mkdir(parents=True, exist_ok=True)
    write_atomically(folder / TABLE, _wide(rows))
    write_atomically(folder / NUMBERS_FILE, _long(rows))
    variants = f"; the variants' own models are ignored: these are values of {file.model}" if file.variants else ""
    document = {
        "to": "servo-table",
        "robot": robot.name,
        "files": {TABLE: f"a row a servo{variants}", NUMBERS_FILE: "the same, a row a number, with units"},
        "servos": [row.document() for row in rows],
        "left_out": [],
    }
    write_atomically(folder / "export.json", json.dumps(document, indent=2) + "\n")
    return document


def shown(value: ServoValue) -> str:
    """What the runs say of the number."""
    text = SHOWN.get(value.status, value.status)
    return text + value.why if value.status == NOT_TESTABLE else text


def _wide(rows: Sequence[ServoRow]) -> str:
    names = [n.name for n in NUMBERS if any(n.name == v.name for row in rows for v in row.values)]
    head = ["actuator", "joint", "kind", "servo", *CONSTANTS]
    for name in names:
        head += [f"{name}_nominal", name, f"{name}_low", f"{name}_high", f"{name}_probability", f"{name}_shown"]
    body = []
    for row in rows:
        motor = {} if row.motor is None else asdict(row.motor)
        line = [row.actuator, row.joint, row.kind, motor.get("servo", ""), *(motor.get(c) for c in CONSTANTS)]
        values = {v.name: v for v in row.values}
        for name in names:
            line += _cells(values[name]) if name in values else [None] * 6
        body.append(line)
    return _csv(head, body)


def _long(rows: Sequence[ServoRow]) -> str:
    head = ["actuator", "joint", "number", "unit", "nominal", "value", "low", "high", "probability", "shown", "effects",
            "alike", "notes"]  # fmt: skip
    body = [
        [row.actuator, row.joint, v.name, v.unit, *_cells(v), " ".join(v.effects), int(v.alike), "; ".join(v.notes)]
        for row in rows
        for v in row.values
    ]
    return _csv(head, body)


def _cells(value: ServoValue) -> list[Any]:
    return [value.nominal, value.value, *(value.ci95 or (None, None)), value.probability, shown(value)]


def _csv(head: Sequence[str], body: Sequence[Sequence[Any]]) -> str:
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(head)
    writer.writerows([[_text(x) for x in line] for line in body])
    return out.getvalue()


def _text(x: Any) -> Any:
    return "" if x is None else f"{x:.9g}" if isinstance(x, float) else x
