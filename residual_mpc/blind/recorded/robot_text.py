"""The robot file of a case: the robot's own keys, and variants by which the two halves have models of their own."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path

from residual_mpc.blind.recorded.half import Setting
from residual_mpc.models.robot_file import RobotFile

ANY = "*"
_BARE = re.compile(r"[A-Za-z0-9_-]+")
_CARRIED_OVER = ("name", "plant", "model", "parameters", "noise", "log", "payload_site", "pose_body", "servo_feedback",
                 "position_sensor", "actuator", "tunable")  # fmt: skip


def settings_of(robot: RobotFile) -> tuple[Setting, ...]:
    """The robot's settings: in general, then variant by variant."""
    general = Setting(ANY, _text(robot.model), robot.parameters)
    found = [general]
    for variant in robot.variants:
        model = variant.overrides.get("model", robot.model)
        given = variant.overrides.get("parameters", {})
        assert isinstance(given, Mapping) and (model is None or isinstance(model, Path))
        found.append(Setting(variant.runs, _text(model), {**robot.parameters, **given}))
    return tuple(found)


def _text(model: Path | None) -> str:
    return model.read_text() if model is not None and model.suffix != ".urdf" else ""


def raw_document(robot: RobotFile) -> dict[str, object]:
    """The robot file as TOML has it; what a robot given by a model's file or by name amounts to."""
    if robot.source.endswith(".toml"):
        return tomllib.loads(Path(robot.source).read_bytes().decode("utf-8-sig"))
    document: dict[str, object] = {"name": robot.name, "plant": robot.plant}
    return document | ({"model": robot.model.name} if robot.model else {})


def robot_text(
    document: Mapping[str, object], log: Mapping[str, str], settings: Mapping[str, Sequence[tuple[Setting, str]]]
) -> str:
    """The case's robot file.

    document: the robot's own. log: its [log]. settings: by half, the settings with the names of their models' files,
    the general one first; that of the first half is the robot's.
    """
    first = next(iter(settings.values()))[0]
    base = {key: document[key] for key in _CARRIED_OVER if key in document}
    base |= {"log": dict(log)} | _of(*first)
    text = _table({k: v for k, v in base.items() if v != {}}, "")
    variants = document.get("variant", [])
    assert isinstance(variants, list)
    for half, its in settings.items():
        for (setting, model), own in zip(its[1:], variants, strict=True):
            text += _variant({**own, "runs": f"{half}_{setting.runs}", **_of(setting, model)})
        text += _variant({"runs": f"{half}_*", **_of(*its[0])})
    return text


def _of(setting: Setting, model: str) -> dict[str, object]:
    found: dict[str, object] = {"model": model, "parameters": dict(setting.parameters)}
    return {key: value for key, value in found.items() if value}


def _variant(table: Mapping[str, object]) -> str:
    return "\n[[variant]]\n" + "".join(f"{_key(k)} = {_value(v)}\n" for k, v in table.items() if k != "log")


def _table(table: Mapping[str, object], head: str) -> str:
    plain = {k: v for k, v in table.items() if not isinstance(v, dict)}
    text = f"\n[{head}]\n" if head and plain else ""
    text += "".join(f"{_key(k)} = {_value(v)}\n" for k, v in plain.items())
    for key, value in table.items():
        if isinstance(value, dict):
            text += _table(value, f"{head}.{_key(key)}" if head else _key(key))
    return text


def _key(key: str) -> str:
    return key if _BARE.fullmatch(key) else json.dumps(key, ensure_ascii=False)


def _value(value: object) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{_key(k)} = {_value(v)}" for k, v in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(_value(v) for v in value) + "]"
    # JSON's strings, booleans and numbers are TOML's
    return json.dumps(value, ensure_ascii=False)
