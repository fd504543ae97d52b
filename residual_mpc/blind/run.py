"""Diagnose the cases of a suite, each in a process and a folder of its own that hold no answer; compare the halves of
a case of recorded runs.

Nothing here reads an answer or knows where one is kept. A case's files are copied to a fresh folder under a
name that says nothing; the process that diagnoses them gets that folder, the command line and a short list of
environment variables.
"""

from __future__ import annotations

import shutil
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from residual_mpc.blind.recorded.case_files import has_halves, is_recorded
from residual_mpc.blind.suite import Entry, Suite, program_version, read_suite, write_json
from residual_mpc.errors import BadInput
from residual_mpc.processes.engine import Engine, run_on
from residual_mpc.processes.isolated import program, run_isolated
from residual_mpc.processes.parallel import Progress, silent

DIAGNOSE, COMPARE = "diagnose", "compare"


@dataclass(frozen=True)
class RunSettings:
    """How to diagnose. ``command`` is any program that takes the options of `residual-mpc diagnose`, or those of
    `residual-mpc compare` on cases of recorded runs."""

    command: str = ""  # empty: this installation's own
    jobs: int = -1  # cases at once; -1: all cores
    timeout: float = 600.0  # s a case
    engine: str = "processes"
    address: str = ""  # of a running Dask scheduler; empty: a local cluster
    seed: int = 0  # handed to every diagnosis

    def __post_init__(self) -> None:
        if self.timeout <= 0:
            raise BadInput(f"must be > 0 s, got {self.timeout}", "--timeout")
        Engine(self.engine, self.jobs, self.address)


@dataclass(frozen=True)
class RunSummary:
    """What a sweep did."""

    cases: int
    diagnosed: int
    failed: int
    resumed: int  # found diagnosed by an earlier call
    seconds: float


def run_suite(folder: Path, results: Path, settings: RunSettings, progress: Progress = silent) -> RunSummary:
    """Diagnose every case that ``results`` does not hold yet; a failing case fails alone, kept as failed."""
    suite = read_suite(folder)
    own = COMPARE if is_recorded(suite) else DIAGNOSE
    command = [*program(settings.command, own), "--seed", str(settings.seed)]
    results.mkdir(parents=True, exist_ok=True)
    todo = [entry for entry in suite.cases if not (results / entry.name / "run.json").exists()]
    begin = time.monotonic()
    outcomes = _spread(suite, todo, results, command, settings, progress)
    good = sum(outcomes)
    return RunSummary(len(suite.cases), good, len(todo) - good, len(suite.cases) - len(todo), time.monotonic() - begin)


def _spread(
    suite: Suite, todo: list[Entry], results: Path, command: list[str], settings: RunSettings, progress: Progress
) -> list[bool]:
    """Whether each case was diagnosed, in order, on all workers."""
    from joblib import delayed

    calls = [
        delayed(diagnose_case)(suite.case(entry).resolve(), entry, (results / entry.name).resolve(), command,
                               settings.timeout)
        for entry in todo
    ]  # fmt: skip
    return run_on(Engine(settings.engine, settings.jobs, settings.address), calls, [e.name for e in todo], progress)


def diagnose_case(case: Path, entry: Entry, result: Path, command: list[str], timeout: float) -> bool:
    """Diagnose one case into ``result`` (``diagnosis.json``, ``run.json``); whether a diagnosis came out.

    The halves of a case of recorded runs are compared into ``comparison.json``.
    """
    with tempfile.TemporaryDirectory(prefix="case-") as place:
        work = Path(place) / "case"
        shutil.copytree(case, work)
        kept: tuple[str, ...]
        if has_halves(work):
            what, kept = ["--before", "before", "--after", "after"], ("comparison.json",)
        else:
            what = sorted(p.name for p in work.iterdir() if p.suffix in (".csv", ".parquet"))
            kept = ("diagnosis.json", "model.json")
        call = [*command, "--robot", "robot.toml", *what, "--out", "out", "--json"]
        for effect in entry.without:
            call += ["--without", effect]
        begin = time.monotonic()
        ended = run_isolated(call, work, timeout)
        status, seconds = ended.status, time.monotonic() - begin
        if status == "done" and not (work / "out" / kept[0]).exists():
            status = f"no {kept[0]}"
        shutil.rmtree(result, ignore_errors=True)
        result.mkdir(parents=True)
        if status == "done":
            for name in kept:
                if (work / "out" / name).exists():
                    shutil.copyfile(work / "out" / name, result / name)
        # written last: its presence says that the case is finished
        write_json(
            result / "run.json",
            {"status": status, "exit_status": ended.exit_status, "seconds": seconds,
             "complaint": ended.complaint[-2000:],
             "version": program_version(), "command": " ".join(command)},
        )  # fmt: skip
    return status == "done"
