"""Follow logs as they arrive, and say when the gap has changed for certain, which effect changed, and since when."""

import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import BinaryIO

import numpy as np

from residual_mpc.api.given import check_robot
from residual_mpc.api.robot import NominalRobot
from residual_mpc.api.run_models import RunModels
from residual_mpc.api.runs import Paths, Runs, listed, read_runs, usable
from residual_mpc.api.written import Source, written
from residual_mpc.diagnosis.options import Options
from residual_mpc.diagnosis.search.measured_commands import not_commanded
from residual_mpc.errors import BadInput
from residual_mpc.models.facts import check_columns
from residual_mpc.models.model_file import Written, model_content
from residual_mpc.models.nominal_numbers import warn_of_differences
from residual_mpc.models.robot_file import measured_over, noise_over
from residual_mpc.monitoring.arrivals.follow import PIPE, follow_files, follow_pipe
from residual_mpc.monitoring.arrivals.rows import RowReader
from residual_mpc.monitoring.cause import CauseFinder
from residual_mpc.monitoring.detection.reference import Reference, build_reference
from residual_mpc.monitoring.events import Event
from residual_mpc.monitoring.model import WatchedModel, watched_model
from residual_mpc.monitoring.monitor import Watch
from residual_mpc.monitoring.monitor import watch as run_watch
from residual_mpc.monitoring.settings import WatchSettings

Progress = Callable[[str, float], None]

ANSWER = "diagnosis.json"


def watch(
    robot: NominalRobot,
    logs: Paths,
    *,
    model: Source | None = None,
    reference: Runs | None = None,
    horizon: float = 1.0,
    once: bool = False,
    seed: int = 0,
    settings: WatchSettings = WatchSettings(),
    pipe: BinaryIO | None = None,
    stopped: Callable[[], bool] = lambda: False,
    progress: Progress = lambda stage, done: None,
) -> Iterator[Event | None]:
    """Watch a stream of logs. Yields events as they happen, and None while nothing arrives.

    Args:
        logs: growing files, folders in which files appear or grow, or "-" for a table on `pipe` (standard input).
        model: a diagnosis or a learned model, or its file; without one the nominal model is watched.
        reference: runs of steady running; by default those of the model's diagnosis, else the beginning of the stream.
        once: end when all that is there was read.
        pipe: what "-" stands for.
        stopped: asked now and then whether to end.

    Raises:
        BadInput: a log that is missing or cannot be read, a model of another robot, or a reference that is too short.
    """
    check_robot(robot)
    paths = listed(logs)
    if PIPE in paths and len(paths) > 1:
        raise BadInput("a pipe cannot be combined with files", PIPE, "give either - or files and folders")
    rng = np.random.default_rng(seed)
    file = None if model is None else written(model)
    if file is not None:
        warn_of_differences(model_content(file), robot.model, file.where)
    made = RunModels(robot)
    watched = watched_model(robot.model, made.of, file)
    noise = dict(robot.file.noise)
    found = _reference(robot, reference, file, watched, horizon, rng, settings, progress)
    options = Options(horizon=horizon, without_because=not_commanded(robot.model, measured_over(robot.file, [])))
    cause = CauseFinder(
        made.of, lambda names: noise_over(robot.file, list(names)), robot.file.tunable, options, progress
    )
    of = Watch(
        watched, cause, lambda: RowReader(robot.file, robot.model.actuators, settings.arrivals),
        lambda run: check_columns([run], [made.of(run.name)]), noise, horizon, found, rng, settings,
    )  # fmt: skip
    arrivals = (
        follow_pipe(pipe or sys.stdin.buffer, settings.arrivals)
        if PIPE in paths
        else follow_files(tuple(Path(p) for p in paths), once, settings.arrivals)
    )
    return run_watch(arrivals, of, stopped)


def _reference(
    robot: NominalRobot, given: Runs | None, model: Written | None, watched: WatchedModel, horizon: float,
    rng: np.random.Generator, settings: WatchSettings, progress: Progress,
) -> Reference | None:  # fmt: skip
    """The reference before anything arrives; None where it has to be learned from the stream."""
    described = "the given reference runs"
    runs = given
    if runs is None and model is not None:
        paths, described = diagnosed_runs(model)
        runs = _read_again(robot, paths) if paths else None
    if runs is None:
        return None
    usable(runs)
    progress("calibrating the test on the reference", 0.5)
    noise = noise_over(robot.file, list(runs.names))
    try:
        return build_reference(runs.runs, watched, noise, horizon, described, rng, settings.detection)
    except BadInput:
        if given is not None:
            raise
        return None


def _read_again(robot: NominalRobot, paths: Sequence[str]) -> Runs:
    """The runs of a model's diagnosis, which the user did not name.

    Raises BadInput where this robot file does not read them.
    """
    try:
        return read_runs(robot, paths)
    except BadInput as error:
        raise BadInput(
            f"the runs of the model's diagnosis cannot serve as the reference: {error.what}",
            error.where,
            "give steady runs as `reference`",
        ) from error


def diagnosed_runs(model: Written) -> tuple[Sequence[str], str]:
    """The runs of the diagnosis that a model is from, as paths, and that diagnosis; none where they are not there any
    more."""
    content, where = model.content, Path(model.where)
    beside = where.parent / ANSWER
    if "run_files" not in content and beside.is_file():
        content, where = written(beside).content, beside
    files = content.get("run_files", [])
    if not isinstance(files, list) or not files:
        return (), ""
    paths = [str(where.parent / str(f)) for f in files]
    there = [p for p in paths if Path(p).exists() or any(mark in p for mark in "*?[")]
    return (paths if len(there) == len(paths) else ()), f"the runs of {where}"
