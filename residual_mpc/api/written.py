"""A diagnosis or a learned model, as a result or as the file that it was saved to."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol

from residual_mpc.api.robot import NominalRobot
from residual_mpc.models.model_file import Written, read_written
from residual_mpc.models.nominal_numbers import KEY as NOMINAL
from residual_mpc.models.nominal_numbers import nominal_numbers
from residual_mpc.models.parameter_units import parameter_unit
from residual_mpc.models.settings import Knob


class Documented(Protocol):
    """A result that holds a model: a diagnosis, or what was learned."""

    def as_written(self) -> Written: ...


Source = str | Path | Documented


def written(source: Source) -> Written:
    """The content of either. Raises BadInput for a file that cannot be read."""
    return read_written(Path(source)) if isinstance(source, str | Path) else source.as_written()


def placed(model: Mapping[str, Any], robot: NominalRobot, folder: Path) -> dict[str, Any]:
    """A model's document as it is written to a folder: with the unit of each value, the nominal numbers of its robot,
    and where the robot file lies, seen from the folder, so that `export` finds it again.

    A robot that was given by its built-in name has no file; its name is enough.
    """
    values = [{**row, "unit": _unit(robot, row)} for row in model["values"]]
    document = {NOMINAL: nominal_numbers(robot.model), **model, "values": values}  # those it was made with, if stated
    source = robot.file.source
    return {**document, "robot_file": os.path.relpath(source, folder)} if source else document


def _unit(robot: NominalRobot, row: Mapping[str, Any]) -> str:
    return parameter_unit(robot.model, Knob(row["effect"], row["target"], row["parameter"]))
