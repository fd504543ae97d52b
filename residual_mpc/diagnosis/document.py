"""A diagnosis as the JSON that scripts rely on, and the augmented model that `gap --model` reads back."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from residual_mpc.diagnosis.records import Diagnosis, Estimate
from residual_mpc.errors import BadInput
from residual_mpc.models.settings import Knob, Term, Values
from residual_mpc.residual.record import KEY, Residual, from_json

SCHEMA = "residual-mpc/diagnosis/1"
MODEL_SCHEMA = "residual-mpc/model/1"


@dataclass(frozen=True, eq=False)
class Written:
    """The content of a diagnosis.json or model.json, and the file that it came from, for messages."""

    content: Mapping[str, Any]
    where: str


def read_written(path: Path) -> Written:
    """A JSON object from a file. Raises BadInput where there is none."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise BadInput(f"cannot be read: {error.strerror}", str(path), "give an existing file") from error
    except ValueError as error:
        raise BadInput(f"not valid JSON: {error}", str(path), "give a diagnosis.json or model.json") from error
    if not isinstance(content, dict):
        raise BadInput("must be a JSON object", str(path), "give a diagnosis.json or model.json")
    return Written(content, str(path))


def to_document(d: Diagnosis) -> dict[str, Any]:
    """diagnosis.json as plain lists, dicts and numbers; no NaN or infinity."""
    expected = d.expected
    shrink = None
    if expected is not None and d.achieved is not None:
        shrink = {
            "expected": expected.value,
            "expected_ci95": list(expected.ci95),
            "value": d.achieved.value,
            "ci95": list(d.achieved.ci95),
        }
    document = {
        "schema": SCHEMA,
        "robot": d.robot,
        "verdict": d.verdict,
        "held_out": [k.document() for k in d.held_out],
        "gap": {
            "nominal": d.gap.nominal,
            "before": d.gap.before,
            "after": d.gap.after,
            "noise_floor": d.gap.noise_floor,
            "horizon": d.gap.horizon,
            "windows": d.gap.windows,
            "skipped": d.gap.skipped,
            "still": list(d.gap.still),
            "channels": {c: {"before": b, "after": a, "noise_floor": f} for c, (b, a, f) in d.gap.channels.items()},
            "horizons": [h.document() for h in d.gap.horizons],
            "constant_velocity": d.gap.constant_velocity,
        },
        "shrink": shrink,
        "where": {
            "stages": [{"name": n, "share": s} for n, s in d.stages],
            "channels": [{"name": n, "share": s} for n, s in d.where.channels],
            "regimes": [{"name": r.name, "share": r.share, "lift": r.lift} for r in d.where.regimes],
            "times": [{"run": s.run, "from": s.start, "to": s.end, "share": s.share} for s in d.where.times],
        },
        "explanation": [
            {
                **_term(c.term),
                "probability": c.probability,
                "parameters": {p.name: _estimate(p) for p in c.parameters},
                "evidence": list(c.evidence),
                "summary": c.summary,
                "only_target": c.only_target,
            }
            for c in d.causes
        ],
        "candidates": [{**_term(c.term), "probability": c.probability, "shrink": c.shrink} for c in d.candidates],
        "confounded": [[_member(m) for m in group] for group in d.groups],
        "not_testable": [{**_term(n.term), "why": n.why} for n in d.not_testable],
        "moved": [{"parameter": m.parameter, "from": m.before, "to": m.after} for m in d.moved],
        "unexplained": {"share": d.unexplained, "learned_residual_shrink": d.learned.shrink},
        "learned": {"by": d.learned.by, "asked": list(d.learned.asked)},
        "remainder": None if d.rest is None else d.rest.document(),
        "next_experiment": d.next_experiment,
        "stages_of_gap": [{"terms": [_term(t) for t in terms], "gap": g} for terms, g in d.steps],
        "rivals": [{"terms": [_term(t) for t in terms], "probability": p} for terms, p in d.rivals],
        "alternatives": [
            {
                "effects": [_term(t) for t in a.terms],
                "instead_of": [_term(t) for t in a.instead_of],
                "ratio": a.ratio,
                "confounded": a.confounded,
                "values": _rows(a.values),
            }
            for a in d.alternatives
        ],
        "setup": {
            **asdict(d.setup),
            "commands": {a: {"low": low, "high": high} for a, (low, high) in d.setup.commands.items()},
        },
        "outliers": {"share": d.outlier_share, "channels": d.outlier_channels} if d.outlier_share > 0 else None,
        "model": to_model(d),
        "notes": list(d.notes),
    }
    clean: dict[str, Any] = finite(document)
    return clean


def to_model(d: Diagnosis) -> dict[str, Any]:
    """The augmented model: every value that differs from the nominal one."""
    outliers = any(c.term.effect == "sensor_outliers" for c in d.causes)
    return {
        "schema": MODEL_SCHEMA,
        "robot": d.robot,
        "values": _rows(d.values),
        "leaves_out_outliers": outliers,
    }


def model_in(written: Written) -> tuple[str, Values, bool]:
    """(robot, values, whether flagged samples are left out). Raises BadInput for neither a model nor a diagnosis."""
    model = _model_in(written)
    try:
        values = values_of(model["values"])
        return str(model["robot"]), values, bool(model.get("leaves_out_outliers", False))
    except (KeyError, TypeError, ValueError) as error:
        raise BadInput(
            f"the model's values cannot be read: {error!r}",
            written.where,
            "write it again with `residual-mpc diagnose`",
        ) from error


def diagnosis_in(written: Written) -> Mapping[str, Any]:
    """The content. Raises BadInput where it is no diagnosis."""
    if written.content.get("schema") != SCHEMA:
        raise BadInput(
            f"schema must be {SCHEMA!r}, got {written.content.get('schema')!r}",
            written.where,
            "give a diagnosis.json written by `residual-mpc diagnose`",
        )
    return written.content


def values_of(rows: Sequence[Mapping[str, Any]]) -> Values:
    """The values of a model as they are written. Raises KeyError, TypeError or ValueError where they cannot be read."""
    values = {Knob(v["effect"], v["target"], v["parameter"]): float(v["value"]) for v in rows}
    for knob, value in values.items():
        if not math.isfinite(value):
            raise ValueError(f"{knob.parameter} of {knob.effect} must be finite, got {value}")
    return values


def residual_in(written: Written, last: bool = False) -> Residual | None:
    """The learned residual, None where it has none; `last`: only what its last case added.

    Raises BadInput for neither a model nor a diagnosis, and for a residual that cannot be read.
    """
    found = _model_in(written).get("last_residual" if last else KEY)
    return None if found is None else from_json(found, written.where)


def _model_in(written: Written) -> Mapping[str, Any]:
    content = written.content
    model = content.get("model") if content.get("schema") == SCHEMA else content
    if not isinstance(model, dict) or model.get("schema") != MODEL_SCHEMA:
        raise BadInput(
            "it contains no model" if model is not content else f"unknown schema {content.get('schema')!r}",
            written.where,
            f"give a diagnosis.json ({SCHEMA}) or a model.json ({MODEL_SCHEMA})",
        )
    return model


def _estimate(p: Estimate) -> dict[str, Any]:
    figures = {"value": p.value, "ci95": list(p.ci95), "unit": p.unit}
    return {**figures, "note": p.note} if p.note else figures


def _rows(values: Values) -> list[dict[str, Any]]:
    return [{**k._asdict(), "value": v} for k, v in values.items()]


def _term(term: Term) -> dict[str, str | None]:
    return {"effect": term.effect, "target": term.target}


def _member(member: tuple[Term, ...]) -> Any:
    return _term(member[0]) if len(member) == 1 else [_term(t) for t in member]


def finite(x: Any) -> Any:
    """The same structure with null for what JSON has no number for."""
    if isinstance(x, dict):
        return {k: finite(v) for k, v in x.items()}
    if isinstance(x, list | tuple):
        return [finite(v) for v in x]
    if isinstance(x, float):
        return x if math.isfinite(x) else None
    return x.item() if hasattr(x, "item") else x
