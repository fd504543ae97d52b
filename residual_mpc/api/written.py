"""A diagnosis or a learned model, as a result or as the file that it was saved to."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol

from residual_mpc.models.model_file import Written, read_written


class Documented(Protocol):
    """A result that holds a model: a diagnosis, or what was learned."""

    def as_written(self) -> Written: ...


Source = str | Path | Documented


def written(source: Source) -> Written:
    """The content of either. Raises BadInput for a file that cannot be read."""
    return read_written(Path(source)) if isinstance(source, str | Path) else source.as_written()


def name_robot_file(model: Mapping[str, Any], robot_file: str, folder: Path) -> dict[str, Any]:
    """A model's document with where its robot file lies, seen from the folder, so that `export` finds it again.

    A robot that was given by its built-in name has no file; its name is enough.
    """
    return {**model, "robot_file": os.path.relpath(robot_file, folder)} if robot_file else dict(model)
