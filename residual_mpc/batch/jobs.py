"""What is diagnosed: a folder of runs for each robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from residual_mpc.errors import BadInput

ROBOT_FILE = "robot.toml"


@dataclass(frozen=True)
class Job:
    """One diagnosis. name: of its folder below the results; robot: file or built-in name; runs: folder of its logs."""

    name: str
    robot: str
    runs: Path

    @property
    def inputs(self) -> dict[str, list[int]]:
        """Size and time of each file that the diagnosis reads from, by path; what has changed is diagnosed again."""
        files = sorted(p for p in self.runs.rglob("*") if p.is_file())
        robot = Path(self.robot)
        files += [robot] if robot.is_file() and robot not in files else []
        stats = {str(p): p.stat() for p in files}
        return {path: [s.st_size, s.st_mtime_ns] for path, s in stats.items()}


def jobs_in(folders: Sequence[Path], robot: str | None, out: Path) -> list[Job]:
    """A job for each folder: with the robot file that lies in it, else with `robot`.

    Raises BadInput for a folder that is not there or has no robot, for two of the same name, and for one that holds the
    results or is among them.
    """
    jobs: dict[str, Job] = {}
    for folder in folders:
        if out.resolve().is_relative_to(folder.resolve()) or folder.resolve().is_relative_to(out.resolve()):
            raise BadInput(
                f"the results of --out {out} and these runs are in one folder", str(folder), "keep them apart"
            )
        if not folder.is_dir():
            raise BadInput("must be a folder with the runs of one robot", str(folder), "give one folder for each robot")
        own = folder / ROBOT_FILE
        if robot is None and not own.is_file():
            raise BadInput(f"no {ROBOT_FILE} in it, and no --robot", str(folder), "name the robot's model with --robot")
        job = Job(
            folder.resolve().name, str(own.resolve()) if own.is_file() else _placed(robot or ""), folder.resolve()
        )
        if job.name in jobs:
            raise BadInput(
                f"two folders are called {job.name!r}: {jobs[job.name].runs} and {job.runs}",
                "batch",
                "rename one, since results are kept by name",
            )
        jobs[job.name] = job
    return list(jobs.values())


def _placed(robot: str) -> str:
    """A file's absolute path, since jobs run elsewhere; a built-in robot's name as it is."""
    path = Path(robot)
    return str(path.resolve()) if path.exists() else robot
