"""What is diagnosed: a folder of runs for each robot."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from residual_mpc.errors import BadInput
from residual_mpc.models.robot_file import read_robot_file

ROBOT_FILE = "robot.toml"


@dataclass(frozen=True)
class Job:
    """One diagnosis. name: of its folder below the results; robot: file or built-in name; runs: folder of its logs."""

    name: str
    robot: str
    runs: Path

    def inputs(self, words: Sequence[str] = ()) -> dict[str, list[int]]:
        """Size and time of each file that the diagnosis may read, by path: the runs, the robot file, everything beside
        its models, such as meshes, and the files among the `words` of the options."""
        files = {*_below(self.runs), *(Path(word) for word in words)}
        files |= {Path(self.robot), *(p for m in _models(self.robot) for p in _below(m.parent))}
        stats = {str(p): p.stat() for p in sorted(files) if p.is_file()}
        return {path: [s.st_size, s.st_mtime_ns] for path, s in stats.items()}


def jobs_in(folders: Sequence[Path], robot: str | None, out: Path) -> list[Job]:
    """A job for each folder: with the robot file that lies in it, else with `robot`.

    Raises BadInput for a folder that is not there or has no robot, for two of the same name, and for one that holds the
    results or is among them.
    """
    jobs: dict[str, Job] = {}
    for folder in folders:
        if out.resolve().is_relative_to(folder.resolve()) or folder.resolve().is_relative_to(out.resolve()):
            raise BadInput(f"it and --out {out} must not contain each other", str(folder), "choose another --out")
        if not folder.is_dir():
            raise BadInput("must be a folder with the runs of one robot", str(folder), "give one folder for each robot")
        own = folder / ROBOT_FILE
        if robot is None and not own.is_file():
            raise BadInput(f"no {ROBOT_FILE} in it, and no --robot", str(folder), "name the robot's model with --robot")
        name = folder.absolute().name
        if name in jobs:
            came = f"two folders are called {name!r}: {jobs[name].runs} and {folder.resolve()}"
            raise BadInput(came, "batch", "rename one, since results are kept by name")
        model = str(own.resolve()) if own.is_file() else _placed(robot or "")
        jobs[name] = Job(name, model, folder.resolve())
    return list(jobs.values())


def _below(folder: Path) -> list[Path]:
    """The files in a folder and those below it."""
    return [Path(where) / name for where, _, names in os.walk(folder, followlinks=True) for name in names]


def _models(robot: str) -> list[Path]:
    """The model files that a robot file names; none of a built-in robot or of a file that cannot be read."""
    try:
        file = read_robot_file(robot)
    except BadInput:  # the diagnosis says why
        return []
    every = (file.model, *(v.overrides.get("model") for v in file.variants))
    return [m for m in every if isinstance(m, Path)]


def _placed(robot: str) -> str:
    """A file's absolute path; a built-in robot's name as it is."""
    path = Path(robot)
    return str(path.resolve()) if path.is_file() else robot
