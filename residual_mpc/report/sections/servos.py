"""The servos: a row each with the numbers that the diagnosis changes, and which numbers these runs do not show."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from residual_mpc.effects.phrase import called
from residual_mpc.effects.servo.numbers import BY_NAME, NUMBERS
from residual_mpc.models.servo_table import NOT_NAMED, NOT_TESTABLE, RETUNED
from residual_mpc.report.evidence.evidence import Evidence
from residual_mpc.report.sections.section import Document, Section, render
from residual_mpc.report.words.numbers import listed, measure, percent
from residual_mpc.report.words.servo import CHANGED, is_changed, nominal_text, noun_of, value_text

Servo = Mapping[str, Any]


def servos(document: Document, evidence: Evidence) -> Section | None:
    """There where a number of a servo is changed."""
    rows: Sequence[Servo] = document.get("servos") or []
    values = [{v["name"]: v for v in row["values"]} for row in rows]
    changed = {v["name"] for row in rows for v in row["values"] if is_changed(v, row)}
    columns = [n for n in NUMBERS if n.name in changed]
    if not columns:
        return None
    body = render(
        "sections/servos.html.jinja",
        noun=(noun := noun_of(document)),
        columns=[(n.text, _unit(n.name, values)) for n in columns],
        rows=[
            (row["actuator"], _joint(row), [_cell(v.get(n.name), _unit(n.name, values)) for n in columns])
            for row, v in zip(rows, values, strict=True)
        ],
        alike=any(v["alike"] for row in rows for v in row["values"]),
        motors=any(row["motor"] for row in rows),
        doubts=any(note.startswith("or ") for row in rows for v in row["values"] for note in v["notes"]),
        unnamed=_unnamed(rows, [n.name for n in columns]),
        untested=_reasons(rows),
    )
    return Section("servos", f"{noun.capitalize()}s", body)


def _joint(row: Servo) -> str:
    """The joint, where it has another name than its actuator."""
    return "" if row["joint"] == row["actuator"] else called("joint", row["joint"])


def _unit(name: str, values: Sequence[Mapping[str, Mapping[str, Any]]]) -> str:
    """Of a whole column; empty where joints turn and slide, so that each cell has its own."""
    units = {str(v[name]["unit"]) for v in values if name in v}
    return units.pop() if len(units) == 1 else ""


def _cell(value: Mapping[str, Any] | None, unit: str) -> dict[str, Any]:
    """unit: of the column, which the cell then leaves out."""
    if value is None:
        return {"text": [], "changed": False}
    written = "1" if unit else None
    if value["status"] not in CHANGED:
        return {"text": ["not shown"], "changed": False, "model": nominal_text(value, written)}
    return {
        "text": value_text(value, written).replace(" (", "\n(", 1).split("\n"),
        "changed": True,
        "model": nominal_text(value, written),
        "motor": "" if value["by_constants"] is None else measure(value["by_constants"], written or value["unit"]),
        "remarks": [", ".join(_remarks(value)), *value["notes"]],
    }


def _remarks(value: Mapping[str, Any]) -> Iterator[str]:
    if value["probability"] is not None:
        yield percent(value["probability"])
    if value["alike"]:
        yield "alike"
    if value["status"] == RETUNED:
        yield RETUNED


def _unnamed(rows: Sequence[Servo], shown: Sequence[str]) -> str:
    """The numbers in which no servo differs from its model."""
    left = [v for row in rows for v in row["values"] if v["name"] not in shown and v["status"] == NOT_NAMED]
    names = [n.text for n in NUMBERS if n.name in {v["name"] for v in left}]
    return listed(names) if names else ""


def _reasons(rows: Sequence[Servo]) -> list[tuple[str, str]]:
    """(number and servos, why) of what could not be tested."""
    out: dict[tuple[str, str], list[str]] = {}
    for row in rows:
        for v in row["values"]:
            if v["status"] == NOT_TESTABLE:
                out.setdefault((v["name"], v["why"]), []).append(row["actuator"])
    whole = len(rows)
    return [
        (BY_NAME[name].text + ("" if len(of) == whole else f" of {listed(of)}"), why) for (name, why), of in out.items()
    ]
