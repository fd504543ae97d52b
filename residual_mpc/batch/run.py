"""Diagnose many robots, each in a process and a folder of its own."""

from __future__ import annotations

import json
import os
import shlex
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from residual_mpc.batch.jobs import Job
from residual_mpc.errors import BadInput
from residual_mpc.files import write_atomically
from residual_mpc.processes.engine import Engine, run_on
from residual_mpc.processes.isolated import program, run_isolated
from residual_mpc.processes.parallel import Progress, silent

ANSWER, STATE = "diagnosis.json", "batch.json"
OLD = (STATE, ANSWER, "model.json", "report.html", "next.csv")  # of an earlier call: a job that fails has none of them
TAKEN = ("--robot", "--out", "--json", "--seed", "--help", "-h", "--video")  # given by the batch, or for one alone


@dataclass(frozen=True)
class BatchSettings:
    """options: of `residual-mpc diagnose`, handed to every diagnosis; timeout: s for one."""

    options: str = ""
    seed: int = 0
    timeout: float = 3600.0
    engine: Engine = Engine()

    def __post_init__(self) -> None:
        if not self.timeout > 0.0:
            raise BadInput(f"must be > 0 s, got {self.timeout:g}", "--timeout")
        for word in self.words:
            if word.partition("=")[0] in TAKEN:
                raise BadInput(f"{word} cannot be handed to every diagnosis", "--options", "leave it out; see --help")

    @property
    def words(self) -> list[str]:
        """The options. Raises BadInput for a quote that is not closed."""
        try:
            return shlex.split(self.options)
        except ValueError as error:
            raise BadInput(f"{error} in {self.options!r}", "--options", "close the quotes") from error


@dataclass(frozen=True)
class Outcome:
    """How one diagnosis ended. status: "done", or why not; complaint: the last line of its stderr where it is not done;
    verdict, before, after, floor, effects: of its answer; resumed: whether an earlier call had made it."""

    name: str
    status: str
    seconds: float
    complaint: str = ""
    verdict: str | None = None
    before: float | None = None
    after: float | None = None
    floor: float | None = None
    effects: tuple[str, ...] = ()
    resumed: bool = False

    @property
    def done(self) -> bool:
        return self.status == "done"

    def document(self) -> dict[str, Any]:
        return asdict(self)


def run_batch(jobs: Sequence[Job], out: Path, settings: BatchSettings, progress: Progress = silent) -> list[Outcome]:
    """The outcome of each job, in order; each has its results in a folder of its name below `out`. A job whose robot,
    inputs, options and version are those of a finished result is not done again; one that fails, fails alone."""
    from joblib import delayed

    command = [*program("", "diagnose"), *settings.words, "--seed", str(settings.seed)]
    kept = {job.name: _finished(job, out / job.name, command) for job in jobs}
    todo = [job for job in jobs if kept[job.name] is None]
    here = Path.cwd()  # where a model of the user's own may be imported from
    calls = [delayed(run_job)(job, (out / job.name).resolve(), here, command, settings.timeout) for job in todo]
    made = run_on(settings.engine, calls, [job.name for job in todo], progress)
    new = dict(zip((job.name for job in todo), made, strict=True))
    return [kept[job.name] or new[job.name] for job in jobs]


def run_job(job: Job, result: Path, here: Path, command: Sequence[str], timeout: float) -> Outcome:
    """Diagnose one robot, from the folder `here`. Resumes what an interrupted call left in the result's folder."""
    begin = time.monotonic()
    try:
        result.mkdir(parents=True, exist_ok=True)
        for name in OLD:
            (result / name).unlink(missing_ok=True)
        state = _state(job, command)  # before the runs are read: they may change meanwhile
        call = [*command, "--robot", job.robot, str(job.runs), "--out", str(result)]
        ended = run_isolated(call, here, timeout, dict(os.environ))
        seconds = time.monotonic() - begin
        if not ended.done:
            lines = [line for line in ended.complaint.splitlines() if line.strip()]
            if not any(result.iterdir()):
                result.rmdir()
            complaint = lines[-1].removeprefix("residual-mpc: ") if lines else ""
            return Outcome(job.name, ended.status, seconds, complaint)
        # written last: its presence says that the job is finished
        write_atomically(result / STATE, json.dumps({"state": state, "seconds": seconds}))
        return _outcome(job, result, seconds)
    except (OSError, ValueError, KeyError) as error:
        return Outcome(job.name, "failed", time.monotonic() - begin, str(error))


def _state(job: Job, command: Sequence[str]) -> dict[str, Any]:
    """What a finished result has to have been made from."""
    return {"command": list(command), "robot": job.robot, "inputs": job.inputs(command), "version": _version()}


def _finished(job: Job, result: Path, command: Sequence[str]) -> Outcome | None:
    """The outcome of an earlier call with the same inputs, options and version; None if there is none."""
    try:
        kept = json.loads((result / STATE).read_text(encoding="utf-8"))
        same = kept["state"] == _state(job, command)
        return _outcome(job, result, kept["seconds"], resumed=True) if same else None
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _outcome(job: Job, result: Path, seconds: float, resumed: bool = False) -> Outcome:
    document = json.loads((result / ANSWER).read_text(encoding="utf-8"))
    gap, named = document["gap"], document["explanation"]
    effects = tuple(e["effect"] + (f" on {e['target']}" if e["target"] else "") for e in named)
    return Outcome(
        job.name, "done", seconds, "", document["verdict"], gap["before"], gap["after"], gap["noise_floor"], effects,
        resumed,
    )  # fmt: skip


def _version() -> str:
    from importlib.metadata import version

    return version("residual-mpc")
