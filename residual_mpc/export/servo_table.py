"""The table of servos as CSV: one file with one row per servo, one with one row per number."""

import csv
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from residual_mpc.effects.servo.numbers import BY_NAME, NUMBERS
from residual_mpc.errors import BadInput
from residual_mpc.export.augmented import settings_from
from residual_mpc.export.servo_choices import Across, across
from residual_mpc.files import write_atomically
from residual_mpc.learning.network.written import network_in
from residual_mpc.models.model_file import Written, model_content
from residual_mpc.models.protocol import Robot
from residual_mpc.models.robot_file import RobotFile
from residual_mpc.models.servo_table import NOT_NAMED, NOT_TESTABLE, ServoRow, ServoValue, servo_rows

TABLE, NUMBERS_FILE = "servos.csv", "servo_numbers.csv"
SHOWN = {NOT_NAMED: "not shown by these runs", NOT_TESTABLE: "not shown by these runs: "}
ACROSS = ("across", "across_low", "across_high", "named_in")
Together = Mapping[tuple[str, str], Across]
CONSTANTS = ("voltage", "resistance", "torque_constant", "p_gain", "duty_per_rad")


def write_servo_table(
    written: Written, found: Mapping[str, Any] | None, robot: Robot, file: RobotFile, folder: Path,
    beside: Sequence[Mapping[str, Any]] = (),
) -> dict[str, Any]:  # fmt: skip
    """Write a row for each servo and describe the files.

    Args:
        found: content of the diagnosis.json, for intervals, probabilities and what could not be tested; None of a
            model.json.
        beside: of other diagnoses of this robot, from other motions: what all of them say together is added.

    Raises:
        BadInput: a model of another robot, or a robot without actuators of its own, such as a differential drive.
    """
    settings_from(written, robot)
    rows = servo_rows(model_content(written) if found is None else found, robot, file)
    if not rows:
        raise BadInput(f"{robot.name!r} has no table of actuators", "`to=servo-table`", "export to casadi, c or jax")
    together = across([rows, *(servo_rows(other, robot, file) for other in beside)]) if beside else {}
    folder.mkdir(parents=True, exist_ok=True)
    write_atomically(folder / TABLE, _wide(rows, together))
    write_atomically(folder / NUMBERS_FILE, _long(rows, together))
    main = "the main model" if file.model is None else file.model.name
    variants = f" (values of {main}: the variants in the robot file are ignored)" if file.variants else ""
    document = {
        "to": "servo-table",
        "robot": robot.name,
        "files": {TABLE: f"one row per servo{variants}", NUMBERS_FILE: "the same, one row per number, with units"},
        "servos": [row.document() for row in rows],
        "across": [{"actuator": a, "number": n, **asdict(x)} for (a, n), x in together.items() if x.named],
        "left_out": list(network_in(written)),
    }
    write_atomically(folder / "export.json", json.dumps(document, indent=2) + "\n")
    return document


def shown(value: ServoValue) -> str:
    """What the runs say of the number."""
    text = SHOWN.get(value.status, value.status)
    return text + value.why if value.status == NOT_TESTABLE else text


def _wide(rows: Sequence[ServoRow], together: Together) -> str:
    names = [n.name for n in NUMBERS if any(n.name == v.name for row in rows for v in row.values)]
    head = ["actuator", "joint", "kind", "servo", *CONSTANTS]
    for name in names:
        head += [f"{name}_nominal", name, f"{name}_low", f"{name}_high", f"{name}_probability", f"{name}_shown"]
        head += [f"{name}_by_constants"] if BY_NAME[name].constant else []
        head += [f"{name}_{text}" for text in ACROSS] if together else []
    body = []
    for row in rows:
        motor = {} if row.motor is None else asdict(row.motor)
        line = [row.actuator, row.joint, row.kind, motor.get("servo", ""), *(motor.get(c) for c in CONSTANTS)]
        values = {v.name: v for v in row.values}
        for name in names:
            line += _cells(values[name]) if name in values else [None] * 6
            line += [values[name].by_constants if name in values else None] if BY_NAME[name].constant else []
            line += _together(together.get((row.actuator, name))) if together else []
        body.append(line)
    return _csv(head, body)


def _long(rows: Sequence[ServoRow], together: Together) -> str:
    head = ["actuator", "joint", "number", "unit", "nominal", "value", "low", "high", "probability", "shown", "effects",
            "alike", "notes", "by_constants", *(ACROSS if together else ())]  # fmt: skip
    body = [
        [row.actuator, row.joint, v.name, v.unit, *_cells(v), " ".join(v.effects), int(v.alike), "; ".join(v.notes),
         v.by_constants, *(_together(together.get((row.actuator, v.name))) if together else ())]
        for row in rows
        for v in row.values
    ]
    return _csv(head, body)


def _together(number: Across | None) -> list[Any]:
    if number is None:
        return [None] * 4
    return [number.value, *(number.ci95 or (None, None)), f"{number.named} of {number.of}"]


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
