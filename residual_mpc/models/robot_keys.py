"""The keys of a robot file: what the value of each must be, and how it is read."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Literal, cast, get_args

from residual_mpc.errors import BadInput
from residual_mpc.logs.columns import GROUPS, PLANAR, SPECIAL, did_you_mean, group, is_measured
from residual_mpc.models.actuators import Actuator, read_actuators
from residual_mpc.models.motors.tables import read_motors

Side = Literal["motor", "link"]


def fields_of(document: Mapping[str, object], folder: Path, where: str) -> dict[str, object]:
    """The fields of `RobotFile` that a table of the file sets. folder: what paths are relative to.

    Raises BadInput for an unknown key or a malformed value.
    """
    values: dict[str, object] = {}
    for key, value in document.items():
        if key in ("variant", "runs"):
            continue
        if key not in READERS:
            raise BadInput(f"unknown key {key!r}", where, did_you_mean(key, [*READERS, "variant"]))
        values[FIELD.get(key, key)] = READERS[key](value, key, where, folder)
    return values


def wrong_value(value: object, wanted: str, key: str, where: str, remedy: str = "") -> BadInput:
    """The error of a value that is not what its key wants."""
    text = repr(value)
    text = text[:80] + "..." if len(text) > 80 else text
    return BadInput(f"{key} must be {wanted}, got {text}", where, remedy)


def text_of(value: object, key: str, where: str, _: Path) -> str:
    """A printable string that is not empty."""
    if not isinstance(value, str) or not value.strip() or not value.isprintable():
        raise wrong_value(value, "a string", key, where, f'write {key} = "..."')
    return value


def _path(value: object, key: str, where: str, folder: Path) -> Path:
    path = folder / text_of(value, key, where, folder)
    try:
        found = path.is_file()
    except OSError:
        found = False
    if not found:
        raise BadInput(
            f"{key} = {value!r}: file {path} not found",
            where,
            f"paths are relative to the robot file's folder, {folder.resolve()}",
        )
    return path


def _side(value: object, key: str, where: str, _: Path) -> Side:
    if value not in get_args(Side):
        raise wrong_value(value, '"motor" or "link"', key, where)
    return cast(Side, value)


def _texts(value: object, key: str, where: str, folder: Path) -> tuple[str, ...]:
    if not isinstance(value, list):
        raise wrong_value(value, "a list of strings", key, where, f'write {key} = ["..."]')
    return tuple(text_of(item, f"an item of {key}", where, folder) for item in value)


def _entries(value: object, key: str, where: str) -> dict[str, object]:
    """The entries of a table; `pose.x = 1`, which is a table within a table in TOML, is meant as "pose.x"."""
    if not isinstance(value, dict):
        raise wrong_value(value, f"a table [{key}]", key, where)
    flat: dict[str, object] = {}
    for name, item in value.items():
        leaves = {name: item}
        if isinstance(item, dict):
            leaves = {f"{name}.{inner}": leaf for inner, leaf in _entries(item, key, where).items()}
        for full, leaf in leaves.items():
            if full in flat:
                raise BadInput(f"{full!r} appears twice in [{key}]", where, "remove one of the two")
            flat[full] = leaf
    return flat


def _number(value: object, key: str, where: str, remedy: str = "") -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise wrong_value(value, "a number", key, where, remedy)
    if not abs(value) < 1e300:  # also catches nan, inf and integers that no float can hold
        raise wrong_value(value, "a finite number", key, where, remedy)
    return float(value)


def _parameters(value: object, key: str, where: str, _: Path) -> dict[str, float]:
    entries = _entries(value, key, where)
    return {name: _number(item, f"{key}.{name}", where, _misplaced(name)) for name, item in entries.items()}


def _noise(value: object, key: str, where: str, _: Path) -> dict[str, float]:
    sigmas: dict[str, float] = {}
    for name, item in _entries(value, key, where).items():
        if not is_measured(name):
            wanted = "names of measured channels, such as position.<joint> or pose.theta"
            raise BadInput(f"names in [{key}] must be {wanted}, got {name!r}", where, _misplaced(name))
        sigmas[name] = _number(item, f"{key}.{name}", where)
        if sigmas[name] <= 0.0:
            remedy = "remove the line to have the noise estimated from the runs"
            raise wrong_value(item, "a positive 1-sigma noise", f"{key}.{name}", where, remedy)
    return sigmas


def _actuators(value: object, key: str, where: str, _: Path) -> dict[str, Actuator]:
    if not isinstance(value, dict):
        raise wrong_value(value, "a set of tables [actuator.<joint>]", key, where)
    return read_actuators(value, where, _misplaced)


def _motors(value: object, key: str, where: str, _: Path) -> dict[tuple[str, str], float | str]:
    if not isinstance(value, dict):
        raise wrong_value(value, "a table [motor] or [motor.<actuator>]", key, where)
    return read_motors(value, where)


def _log(value: object, key: str, where: str, folder: Path) -> dict[str, str]:
    columns: dict[str, str] = {}
    for name, item in _entries(value, key, where).items():
        if group(name) is None and name not in SPECIAL:
            remedy = _misplaced(name) or _log_remedy(name)
            raise BadInput(f"{name!r} in [{key}] is not a name of the log format", where, remedy)
        columns[name] = text_of(item, f"{key}.{name}", where, folder)
    return columns


def _log_remedy(name: str) -> str:
    head, _, tail = name.partition(".")
    if head in ("pose", "twist"):
        return did_you_mean(name, [f"{head}.{axis}" for axis in PLANAR])
    if not tail:
        return "names are t, run, command.<actuator>, position.<joint>, velocity.<joint>, pose.x and so on"
    return did_you_mean(head, GROUPS)


def _misplaced(name: str) -> str:
    """In TOML a key below a [table] header belongs to that table, which is easily forgotten."""
    return f"if this is the robot's key {name!r}, move it above the first [table]" if name in READERS else ""


READERS: Mapping[str, Callable[[object, str, str, Path], object]] = {
    "name": text_of,
    "plant": text_of,
    "model": _path,
    "parameters": _parameters,
    "noise": _noise,
    "log": _log,
    "payload_site": text_of,
    "pose_body": text_of,
    "servo_feedback": _side,
    "position_sensor": _side,
    "actuator": _actuators,
    "motor": _motors,
    "held": _texts,
    "tunable": _texts,
}
FIELD = {"actuator": "actuators", "motor": "motors"}  # of `RobotFile`, where its name is not the key's
