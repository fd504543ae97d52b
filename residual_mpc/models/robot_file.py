"""The robot file: which nominal model the gap is measured against, and how its logs are named."""

from __future__ import annotations

import fnmatch
import math
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal, cast, get_args

from residual_mpc.errors import BadInput
from residual_mpc.logs.columns import GROUPS, PLANAR, SPECIAL, did_you_mean, group, is_measured, member
from residual_mpc.models.actuators import Actuator, read_actuators

Side = Literal["motor", "link"]
MODELS = (".xml", ".mjcf", ".urdf")  # MJCF and URDF, given in place of a robot file
MERGED = ("parameters", "noise", "log", "actuators")  # a variant overrides single entries of these


@dataclass(frozen=True)
class Variant:
    """Runs recorded with another setting of the same robot.

    Attributes:
        runs: glob pattern that the run's name has to match.
        overrides: the fields of `RobotFile` that differ for these runs, already checked and converted.
    """

    runs: str
    overrides: Mapping[str, object]


@dataclass(frozen=True)
class RobotFile:
    """What a robot file says, checked; a value that the file leaves out has its default here.

    Attributes:
        name: the robot's name.
        plant: a built-in plant, an entry point, or "package.module:factory".
        folder: the folder that relative paths refer to.
        model: MJCF or URDF file of the nominal robot, None for plants without one.
        parameters: nominal values, SI units.
        noise: 1-sigma sensor noise of measured channels, in the channel's unit; absent ones are estimated.
        log: log name -> column of the table, where they differ; one column may serve under several names.
        payload_site: MuJoCo site at which a payload sits, None for the model's own choice.
        pose_body: body whose planar pose `pose.*` reports, None for a robot that does not drive.
        servo_feedback: side of the gear that closes a position loop.
        position_sensor: side of the gear that `position.*` reports.
        actuators: by joint, for a model that has none of its own, such as a URDF.
        tunable: glob patterns of nominal parameters that are free in every hypothesis.
        variants: other settings; see `for_run`.
        source: where it was read, for messages and for model.json; empty for a robot given by name.
    """

    name: str
    plant: str
    folder: Path = Path()
    model: Path | None = None
    parameters: Mapping[str, float] = field(default_factory=dict)
    noise: Mapping[str, float] = field(default_factory=dict)
    log: Mapping[str, str] = field(default_factory=dict)
    payload_site: str | None = None
    pose_body: str | None = None
    servo_feedback: Side = "motor"
    position_sensor: Side = "link"
    actuators: Mapping[str, Actuator] = field(default_factory=dict)
    tunable: tuple[str, ...] = ()
    variants: tuple[Variant, ...] = ()
    source: str = ""

    @property
    def measured_commands(self) -> tuple[str, ...]:
        """Actuators whose command is a measured column (a wheel's encoder): it drives the model, nothing was sent."""
        measured = {column for name, column in self.log.items() if is_measured(name)}
        return tuple(
            member(name)
            for name, column in self.log.items()
            if group(name) == "command" and (is_measured(column) or column in measured)
        )


def read_robot_file(path_or_name: str | Path) -> RobotFile:
    """Read a robot file, or take an MJCF or URDF file or the name of a built-in robot.

    A model file is a robot of the plant `mujoco` with every other key at its default. A text that is neither an
    existing file nor looks like a path is the name of a robot that the plants know.

    Raises:
        BadInput: a missing or unreadable file, an unknown key, a malformed value, or a missing model file.
    """
    path = Path(path_or_name)
    if not path.is_file():
        return _named(str(path_or_name), path)
    if path.suffix in MODELS:
        return RobotFile(path.stem, "mujoco", path.parent, path, source=str(path))
    document = _document(path)
    where = str(path)
    values = _fields(document, path.parent, where)
    tables = enumerate(_variants(document, where), start=1)
    variants = tuple(_variant(table, number, path.parent, where) for number, table in tables)
    if "plant" not in values:
        raise BadInput(
            "key 'plant' is missing",
            where,
            'add a line such as plant = "diff_drive" or plant = "mujoco" above the first [table]',
        )
    values.setdefault("name", path.stem)
    return RobotFile(folder=path.parent, variants=variants, source=where, **values)  # type: ignore[arg-type]


def for_run(robot: RobotFile, run_name: str) -> RobotFile:
    """The robot as it was in one run: the first variant whose pattern matches the run's name is applied.

    Entries of `parameters`, `noise`, `log` and `actuators` are overridden one by one, any other key as a whole. A run
    name that was made unique by a prefix ("table/run") also matches by what follows its last slash.
    """
    names = (run_name, run_name.rpartition("/")[2])
    for variant in robot.variants:
        if any(fnmatch.fnmatchcase(name, variant.runs) for name in names):
            changes: dict[str, object] = dict(variant.overrides)
            for key in MERGED:
                if key in changes:
                    changes[key] = {**getattr(robot, key), **cast(Mapping[str, object], changes[key])}
            return replace(robot, **changes)  # type: ignore[arg-type]
    return robot


def noise_over(robot: RobotFile, run_names: Sequence[str]) -> dict[str, float]:
    """The 1-sigma noise of each channel over all runs: the root mean square of what the runs' variants state, since a
    channel is weighed alike in every run. Runs that state none do not count."""
    stated: dict[str, list[float]] = {}
    for name in run_names:
        for channel, sigma in for_run(robot, name).noise.items():
            stated.setdefault(channel, []).append(sigma)
    return {channel: math.sqrt(math.fsum(x * x for x in each) / len(each)) for channel, each in stated.items()}


def measured_over(robot: RobotFile, run_names: Sequence[str]) -> tuple[str, ...]:
    """The actuators whose command is a measured column in every run, see `RobotFile.measured_commands`."""
    each = [set(for_run(robot, name).measured_commands) for name in run_names]
    return tuple(a for a in robot.measured_commands if all(a in measured for measured in each))


def _named(text: str, path: Path) -> RobotFile:
    if not text.strip():
        raise BadInput("--robot must be a robot file or the name of a built-in robot, got an empty string")
    if path.is_dir() and (path / "robot.toml").is_file():
        raise BadInput("must be a robot file, got a folder", text, f"give {path / 'robot.toml'}")
    if (path.suffix and ":" not in text) or len(path.parts) > 1:
        raise BadInput("robot file not found", text, "check the path, or give the name of a built-in robot")
    return RobotFile(name=text, plant=text)


def _document(path: Path) -> dict[str, object]:
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as fault:
        raise BadInput(
            f"must be a TOML file in UTF-8, got an invalid byte at position {fault.start}",
            str(path),
            "save it as UTF-8",
        ) from fault
    except OSError as fault:
        raise BadInput(f"cannot be read ({fault.strerror})", str(path)) from fault
    try:
        return tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError, ValueError) as fault:
        raise BadInput(
            f"not valid TOML: {fault}",
            str(path),
            'put strings and names with dots in quotes, but not numbers: "pose.x" = 0.002',
        ) from fault


def _fields(document: Mapping[str, object], folder: Path, where: str) -> dict[str, object]:
    """The fields of `RobotFile` that a table of the file sets."""
    values: dict[str, object] = {}
    for key, value in document.items():
        if key in ("variant", "runs"):
            continue
        if key not in READERS:
            raise BadInput(f"unknown key {key!r}", where, did_you_mean(key, [*READERS, "variant"]))
        values[FIELD.get(key, key)] = READERS[key](value, key, where, folder)
    return values


def _variants(document: Mapping[str, object], where: str) -> list[Mapping[str, object]]:
    variants = document.get("variant", [])
    if not isinstance(variants, list) or not all(isinstance(v, dict) for v in variants):
        raise _wrong(variants, "a list of [[variant]] tables", "variant", where)
    return variants


def _variant(table: Mapping[str, object], number: int, folder: Path, where: str) -> Variant:
    where = f"{where}, [[variant]] {number}"
    if "runs" not in table:
        raise BadInput(
            "key 'runs' is missing; it must be a pattern for the names of the runs",
            where,
            'add a line such as runs = "loaded_*"',
        )
    if "variant" in table:
        raise BadInput("a [[variant]] must not contain another", where, "write one after the other")
    return Variant(_text(table["runs"], "runs", where, folder), _fields(table, folder, where))


def _wrong(value: object, wanted: str, key: str, where: str, remedy: str = "") -> BadInput:
    text = repr(value)
    text = text[:80] + "..." if len(text) > 80 else text
    return BadInput(f"{key} must be {wanted}, got {text}", where, remedy)


def _text(value: object, key: str, where: str, _: Path) -> str:
    if not isinstance(value, str) or not value.strip() or not value.isprintable():
        raise _wrong(value, "a string", key, where, f'write {key} = "..."')
    return value


def _path(value: object, key: str, where: str, folder: Path) -> Path:
    path = folder / _text(value, key, where, folder)
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
        raise _wrong(value, '"motor" or "link"', key, where)
    return cast(Side, value)


def _texts(value: object, key: str, where: str, folder: Path) -> tuple[str, ...]:
    if not isinstance(value, list):
        raise _wrong(value, "a list of strings", key, where, f'write {key} = ["..."]')
    return tuple(_text(item, f"an item of {key}", where, folder) for item in value)


def _entries(value: object, key: str, where: str) -> dict[str, object]:
    """The entries of a table; `pose.x = 1`, which is a table within a table in TOML, is meant as "pose.x"."""
    if not isinstance(value, dict):
        raise _wrong(value, f"a table [{key}]", key, where)
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
        raise _wrong(value, "a number", key, where, remedy)
    if not abs(value) < 1e300:  # also catches nan, inf and integers that no float can hold
        raise _wrong(value, "a finite number", key, where, remedy)
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
            raise _wrong(item, "a positive 1-sigma noise", f"{key}.{name}", where, remedy)
    return sigmas


def _actuators(value: object, key: str, where: str, _: Path) -> dict[str, Actuator]:
    if not isinstance(value, dict):
        raise _wrong(value, "a set of tables [actuator.<joint>]", key, where)
    return read_actuators(value, where)


def _log(value: object, key: str, where: str, folder: Path) -> dict[str, str]:
    columns: dict[str, str] = {}
    for name, item in _entries(value, key, where).items():
        if group(name) is None and name not in SPECIAL:
            remedy = _misplaced(name) or _log_remedy(name)
            raise BadInput(f"{name!r} in [{key}] is not a name of the log format", where, remedy)
        columns[name] = _text(item, f"{key}.{name}", where, folder)
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
    "name": _text,
    "plant": _text,
    "model": _path,
    "parameters": _parameters,
    "noise": _noise,
    "log": _log,
    "payload_site": _text,
    "pose_body": _text,
    "servo_feedback": _side,
    "position_sensor": _side,
    "actuator": _actuators,
    "tunable": _texts,
}
FIELD = {"actuator": "actuators"}  # of `RobotFile`, where its name is not the key's
