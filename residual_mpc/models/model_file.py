"""What a diagnosis wrote, read back: the augmented model of a diagnosis.json or model.json."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from residual_mpc.errors import BadInput
from residual_mpc.models.settings import Knob, Values

DIAGNOSIS_SCHEMA = "residual-mpc/diagnosis/1"
MODEL_SCHEMA = "residual-mpc/model/1"


@dataclass(frozen=True, eq=False)
class Written:
    """The content of a diagnosis.json or model.json, and the file that it came from, for messages."""

    content: Mapping[str, Any]
    where: str


def read_written(path: Path) -> Written:
    """A JSON object from a file. Raises BadInput where there is none."""
    if path.is_dir():
        inside = [path / n for n in ("diagnosis.json", "model.json") if (path / n).is_file()]
        remedy = f"give {inside[0]}" if inside else "give a diagnosis.json or model.json"
        raise BadInput("must be a file, got a folder", str(path), remedy)
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise BadInput(f"cannot be read: {error.strerror}", str(path), "give an existing file") from error
    except ValueError as error:
        raise BadInput(f"not valid JSON: {error}", str(path), "give a diagnosis.json or model.json") from error
    if not isinstance(content, dict):
        raise BadInput("must be a JSON object", str(path), "give a diagnosis.json or model.json")
    return Written(content, str(path))


def model_in(written: Written) -> tuple[str, Values, bool]:
    """(robot, values, whether flagged samples are left out). Raises BadInput for neither a model nor a diagnosis."""
    model = model_content(written)
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
    if written.content.get("schema") != DIAGNOSIS_SCHEMA:
        raise BadInput(
            f"schema must be {DIAGNOSIS_SCHEMA!r}, got {written.content.get('schema')!r}",
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


def model_content(written: Written) -> Mapping[str, Any]:
    """The model in a diagnosis or model file. Raises BadInput for neither."""
    content = written.content
    model = content.get("model") if content.get("schema") == DIAGNOSIS_SCHEMA else content
    if not isinstance(model, dict) or model.get("schema") != MODEL_SCHEMA:
        raise BadInput(
            "it contains no valid model" if model is not content else f"unknown schema {content.get('schema')!r}",
            written.where,
            f"give a diagnosis.json ({DIAGNOSIS_SCHEMA}) or a model.json ({MODEL_SCHEMA})",
        )
    return model
