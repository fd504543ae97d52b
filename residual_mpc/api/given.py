"""Whether the functions of the API were given what they work on."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from residual_mpc.api.robot import NominalRobot
from residual_mpc.api.runs import Runs, usable
from residual_mpc.errors import BadInput

LONGEST_STEP = 0.5  # s, of a model for a controller; the same limit as on the command line


def check_robot(robot: Any) -> None:
    """Raises BadInput for anything but a robot, such as the path of its file."""
    if not isinstance(robot, NominalRobot):
        raise BadInput(f"robot must be a NominalRobot, got {_shown(robot)}", "robot", "give rm.load_robot(file)")


def check_given(robot: Any, *runs: Any) -> None:
    """Raises BadInput for anything but a robot and runs that can be used."""
    check_robot(robot)
    for some in runs:
        if not isinstance(some, Runs):
            raise BadInput(f"runs must be Runs, got {_shown(some)}", "runs", "give rm.read_runs(robot, paths)")
        usable(some)


def check_seconds(seconds: Any, where: str) -> None:
    """Raises BadInput unless a time is a positive number of seconds."""
    if not (isinstance(seconds, int | float | np.number) and np.isfinite(seconds) and seconds > 0.0):
        raise BadInput(
            f"must be a positive number of seconds, got {seconds!r}", where, "leave it out for the usual one"
        )


def check_time_step(dt: Any) -> None:
    """Raises BadInput unless the time step of a model is positive and at most `LONGEST_STEP`."""
    if not (isinstance(dt, int | float | np.number) and 0.0 < dt < np.inf):
        raise BadInput(f"the time step must be a positive number of seconds, got {dt!r}", "dt", "give it in seconds")
    if dt > LONGEST_STEP:
        raise BadInput(
            f"the time step must be at most {LONGEST_STEP:g} s, got {dt:g} s", "dt",
            "give the time between two commands of your controller, in seconds",
        )  # fmt: skip


def check_not_over(source: str | Path, folder: Path | None) -> None:
    """Raises BadInput where a learned model would overwrite the files of what it is made from."""
    file = Path(source)
    own = file.name in ("diagnosis.json", "model.json")
    if own and folder is not None and file.exists() and file.resolve().parent == folder.resolve():
        which = "model.json" if file.name == "model.json" else f"model.json and report.html beside {file.name}"
        raise BadInput(f"would overwrite {which}, which it is made from", str(folder), "choose another folder")


def check_apart(diagnoses: Sequence[tuple[str, Mapping[str, Any]]]) -> None:
    """Raises BadInput where two diagnoses, as (file, content), share a run: they are not independent."""
    seen: dict[str, str] = {}
    for file, content in diagnoses:
        for run in content.get("runs") or ():
            if run["digest"] in seen:
                raise BadInput(
                    f"run {run['name']} was used in {seen[run['digest']]} too: diagnoses that are pooled must share no "
                    "runs", file, "give diagnoses of other runs",
                )  # fmt: skip
        seen |= {run["digest"]: file for run in content.get("runs") or ()}


def _shown(thing: Any) -> str:
    return f"{type(thing).__name__} {thing!r:.60}" if isinstance(thing, str | Path) else type(thing).__name__
