"""The folder of a case: robot file, models, and the runs of both halves."""

from __future__ import annotations

import shutil
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path

from residual_mpc.blind.recorded.half import Half, Setting
from residual_mpc.blind.recorded.log import Log, table_of
from residual_mpc.blind.recorded.mjcf import parse
from residual_mpc.blind.recorded.robot_text import raw_document, robot_text
from residual_mpc.blind.suite import Suite
from residual_mpc.errors import BadInput
from residual_mpc.files import write_atomically
from residual_mpc.logs.columns import is_measured
from residual_mpc.models.robot_file import RobotFile

HALVES = ("before", "after")
MOST_FILES = 40  # runs of a half; more are put into one table


def has_halves(case: Path) -> bool:
    """Whether the folder is that of a case of recorded runs."""
    return all((case / half).is_dir() for half in HALVES)


def is_recorded(suite: Suite) -> bool:
    """Whether the cases of a suite are of recorded runs."""
    return bool(suite.cases) and all(has_halves(suite.case(entry)) for entry in suite.cases)


def aliases_of(robot: RobotFile) -> dict[str, str]:
    """Command column -> the measured column that stands in for it."""
    measured = {column: name for name, column in robot.log.items() if is_measured(name)}
    columns = {f"command.{a}": robot.log[f"command.{a}"] for a in robot.measured_commands}
    return {command: measured.get(column, column) for command, column in columns.items()}


def write_case(folder: Path, robot: RobotFile, before: Half, after: Half) -> None:
    """Write the case to ``folder``. Both halves are written alike, so that files tell nothing of what was changed."""
    document = raw_document(robot)
    settings = {}
    for name, half in zip(HALVES, (before, after), strict=True):
        settings[name] = [(s, _write_model(folder, f"{name}_{i}", s, robot)) for i, s in enumerate(half.settings)]
        _write_runs(folder / name, half.logs)
    write_atomically(folder / "robot.toml", robot_text(document, aliases_of(robot), settings))


def _write_model(folder: Path, stem: str, setting: Setting, robot: RobotFile) -> str:
    """The name of the setting's model in ``folder``; empty where the robot has none."""
    if setting.model:
        write_atomically(folder / f"{stem}.xml", parse(setting.model).text())
        assert robot.model is not None
        _copy_assets(setting.model, robot.model.parent, folder)
        return f"{stem}.xml"
    if robot.model is None:
        return ""
    shutil.copyfile(robot.model, folder / f"{stem}{robot.model.suffix}")
    return f"{stem}{robot.model.suffix}"


def _copy_assets(text: str, origin: Path, folder: Path) -> None:
    """The meshes and pictures that a model refers to, under the same relative paths."""
    root = ET.fromstring(text)
    compiler = {key: value for c in root.findall("compiler") for key, value in c.attrib.items()}
    for element in root.iter():
        if "file" not in element.attrib:
            continue
        below = {"mesh": "meshdir", "texture": "texturedir"}.get(element.tag, "assetdir")
        path = Path(compiler.get(below, compiler.get("assetdir", ""))) / element.attrib["file"]
        if path.is_absolute() or ".." in path.parts or not (origin / path).is_file():
            raise BadInput(
                f"the model refers to the file {path}, which is not in its folder", "--robot", "put it beside the model"
            )
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(origin / path, folder / path)


def _write_runs(folder: Path, logs: tuple[Log, ...]) -> None:
    import pandas as pd

    folder.mkdir(parents=True)
    tables: Mapping[str, pd.DataFrame] = {log.name: pd.DataFrame(table_of(log)) for log in logs}
    if len(tables) > MOST_FILES:
        whole = pd.concat([table.assign(run=name) for name, table in tables.items()], ignore_index=True)
        whole.to_parquet(folder / "runs.parquet", index=False)
        return
    for name, table in tables.items():
        table.to_parquet(folder / f"{name}.parquet", index=False)
