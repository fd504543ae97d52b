"""The robot file: which nominal model the gap is measured against, and how its logs are named."""

from __future__ import annotations

import fnmatch
import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import cast

from residual_mpc.errors import BadInput
from residual_mpc.logs.columns import group, is_measured, member, within_topic
from residual_mpc.models.actuators import Actuator
from residual_mpc.models.motors.tables import Entries, check_motors
from residual_mpc.models.robot_keys import Side, fields_of, text_of, wrong_value

MODELS = (".xml", ".mjcf", ".urdf", ".xacro")  # given in place of a robot file; a xacro is refused with a remedy
WHEELS = ("wheel_radius", "track_width")  # parameters of a robot that the velocity of its body can drive
MERGED = ("parameters", "noise", "log", "actuators", "motors")  # a variant overrides single entries of these


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
        motors: constants of the motors, see `residual_mpc.models.motors.tables.motor_of`.
        held: joints or actuators that nobody commands: they stay where each window starts.
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
    motors: Entries = field(default_factory=dict)
    held: tuple[str, ...] = ()
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
            if group(name) == "command" and (is_measured(within_topic(column)) or column in measured)
        )

    @property
    def logs(self) -> tuple[Mapping[str, str], ...]:
        """Every [log] that may apply to a run: the robot's own, and its variants' on top of it."""
        variants = [v.overrides["log"] for v in self.variants if "log" in v.overrides]
        return (self.log, *({**self.log, **v} for v in variants if isinstance(v, Mapping)))

    def log_of(self, run_name: str) -> Mapping[str, str]:
        """The [log] that applies to a run."""
        return for_run(self, run_name).log

    def wheels_of(self, run_name: str) -> tuple[float, float] | None:
        """(`wheel_radius`, `track_width`) in a run, m; None where the robot file does not state both."""
        radius, track = map(for_run(self, run_name).parameters.get, WHEELS)
        return None if radius is None or track is None else (radius, track)


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
    values = fields_of(document, path.parent, where)
    tables = enumerate(_variants(document, where), start=1)
    variants = tuple(_variant(table, number, path.parent, where) for number, table in tables)
    if "plant" not in values:
        raise BadInput(
            "key 'plant' is missing",
            where,
            'add a line such as plant = "diff_drive" or plant = "mujoco" above the first [table]',
        )
    values.setdefault("name", path.stem)
    robot = RobotFile(folder=path.parent, variants=variants, source=where, **values)  # type: ignore[arg-type]
    for motors in (robot.motors, *({**robot.motors, **_motors_in(v)} for v in variants)):
        check_motors(motors, where)
    return robot


def for_run(robot: RobotFile, run_name: str) -> RobotFile:
    """The robot as it was in one run: the first variant whose pattern matches the run's name is applied.

    Entries of `parameters`, `noise`, `log`, `actuators` and `motors` are overridden one by one, any other key as a
    whole. A run name that was made unique by a prefix ("table/run") also matches by what follows its last slash.
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


def _motors_in(variant: Variant) -> Entries:
    return cast(Entries, variant.overrides.get("motors", {}))


def _named(text: str, path: Path) -> RobotFile:
    if not text.strip():
        raise BadInput("the robot must be a robot file or the name of a built-in robot, got an empty string")
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


def _variants(document: Mapping[str, object], where: str) -> list[Mapping[str, object]]:
    variants = document.get("variant", [])
    if not isinstance(variants, list) or not all(isinstance(v, dict) for v in variants):
        raise wrong_value(variants, "a list of [[variant]] tables", "variant", where)
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
    return Variant(text_of(table["runs"], "runs", where, folder), fields_of(table, folder, where))
