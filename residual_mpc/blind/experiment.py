"""Carry out what the diagnoses of a suite propose: plan, drive the hidden robot, diagnose anew.

Who plans and who diagnoses is a process in a folder of its own that holds no answer, as in `blind run`. The robot
alone is drawn from the answer; of it only the runs that it logs leave this file. Its case is written anew on the way,
and has to be the one that was sealed.
"""

from __future__ import annotations

import json
import shutil
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np

from residual_mpc.blind.commanded_motion import CommandedMotion, read_commanded_motions
from residual_mpc.blind.families import make_hidden_robot
from residual_mpc.blind.run import diagnose_case
from residual_mpc.blind.seal import digest, read_sealed
from residual_mpc.blind.suite import NOTHING_OPEN, RECORD, Entry, Suite, program_version, read_suite, write_json
from residual_mpc.errors import BadInput
from residual_mpc.processes.isolated import program, run_isolated
from residual_mpc.processes.parallel import Progress, run_in_parallel


@dataclass(frozen=True)
class ExperimentSettings:
    """command, planner: the programs that diagnose and plan, with the options of `diagnose` and `excite` (empty: this
    installation's); timeout: s that each may take; seed: handed to both, and part of the robot's noise."""

    command: str = ""
    planner: str = ""
    jobs: int = -1
    timeout: float = 600.0
    seed: int = 0

    def __post_init__(self) -> None:
        if self.timeout <= 0:
            raise BadInput(f"must be > 0 s, got {self.timeout}", "--timeout")


@dataclass(frozen=True)
class ExperimentSummary:
    """What a sweep did; open: cases whose first diagnosis left something open."""

    cases: int
    open: int
    failed: int
    resumed: int
    seconds: float


def run_experiments(
    folder: Path, answers: Path, results: Path, out: Path, settings: ExperimentSettings, progress: Progress
) -> ExperimentSummary:
    """One experiment for every case whose diagnosis in ``results`` leaves something open; a failing one fails alone.

    Cases that ``out`` holds already are left as they are.
    """
    from joblib import delayed

    suite = read_suite(folder)
    if not results.is_dir():
        raise BadInput("this folder contains no diagnoses", str(results), "run `residual-mpc blind run` first")
    out.mkdir(parents=True, exist_ok=True)
    todo = [entry for entry in suite.cases if not (out / entry.name / RECORD).exists()]
    begin = time.monotonic()
    calls = (delayed(_one)(suite, e, answers, results / e.name, (out / e.name).resolve(), settings) for e in todo)
    run_in_parallel(calls, [entry.name for entry in todo], progress, n_jobs=settings.jobs)
    status = [str(json.loads((out / e.name / RECORD).read_text())["status"]) for e in suite.cases]
    opened = [s for s in status if s != NOTHING_OPEN]
    failed = sum(s != "done" for s in opened)
    return ExperimentSummary(len(status), len(opened), failed, len(status) - len(todo), time.monotonic() - begin)


def is_open(document: dict[str, Any]) -> bool:
    """Whether a diagnosis leaves something open that an experiment may settle."""
    return bool(document.get("alternatives") or document.get("confounded") or document["verdict"] == "unknown")


def _one(suite: Suite, entry: Entry, answers: Path, first: Path, out: Path, settings: ExperimentSettings) -> None:
    """Plan, drive and diagnose one case into ``out``."""
    begin = time.monotonic()
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    record: dict[str, Any] = {}
    try:
        record = _carried_out(suite, entry, answers, first, out, settings)
    except Exception as error:  # one case fails alone, and counts as unresolved
        record = {"status": f"{type(error).__name__}: {error}"}
    record |= {"seconds": time.monotonic() - begin, "version": program_version()}
    write_json(out / RECORD, record)  # last: its presence says that the case is finished


def _carried_out(
    suite: Suite, entry: Entry, answers: Path, first: Path, out: Path, settings: ExperimentSettings
) -> dict[str, Any]:
    document = first / "diagnosis.json"
    if not document.exists() or not is_open(json.loads(document.read_text())):
        return {"status": NOTHING_OPEN}
    case = suite.case(entry).resolve()
    with tempfile.TemporaryDirectory(prefix="plan-") as place:
        plan = _plan(case, document, Path(place), settings)
        shutil.copyfile(Path(place) / "next.csv", out / "next.csv")
    motions = read_commanded_motions(out / "next.csv", plan["sensors"])
    with tempfile.TemporaryDirectory(prefix="case-") as place:
        more = Path(place) / "case"
        shutil.copytree(case, more)
        played = _played(suite, entry, answers, motions, more, settings.seed)
        command = [*program(settings.command, "diagnose"), "--seed", str(settings.seed)]
        again = out / "again"
        done = diagnose_case(more, entry, again, command, settings.timeout)
        for name in played:
            shutil.copyfile(more / name, out / name)
    status = "done" if done else f"diagnosis: {json.loads((again / 'run.json').read_text())['status']}"
    return {"status": status, "plan": plan, "runs": played}


def _plan(case: Path, document: Path, place: Path, settings: ExperimentSettings) -> dict[str, Any]:
    """What `excite` says of the experiment, its commands left in ``place/next.csv``."""
    for path in case.iterdir():
        if path.suffix not in (".csv", ".parquet"):
            copy = shutil.copytree if path.is_dir() else shutil.copyfile
            copy(path, place / path.name)
    shutil.copyfile(document, place / "diagnosis.json")
    call = [*program(settings.planner, "excite"), "diagnosis.json", "--robot", "robot.toml"]
    call += ["--out", "next.csv", "--json", "--seed", str(settings.seed)]
    ended = run_isolated(call, place, settings.timeout)
    if not ended.done:
        raise RuntimeError(f"excite: {ended.status}: {ended.complaint[-500:]}")
    plan: dict[str, Any] = json.loads(ended.said)["excite"]
    return plan


def _played(
    suite: Suite, entry: Entry, answers: Path, motions: tuple[CommandedMotion, ...], runs: Path, seed: int
) -> list[str]:
    """Names of the files that the case's robot logs to the folder ``runs``."""
    sealed = read_sealed(answers / f"{entry.name}.json")
    answer = sealed.answer
    if sealed.commitment != entry.commitment:
        raise BadInput("the answer does not match its commitment", entry.name, "make the suite again")
    before = {p.name for p in runs.iterdir()}
    with tempfile.TemporaryDirectory(prefix="robot-") as place:
        twin = make_hidden_robot(answer.family, answer.level, answer.seed, place)
        if digest(Path(place) / "case") != sealed.data:
            raise BadInput("this version draws a different robot for this case", entry.name, "make the suite again")
        for k, motion in enumerate(motions):
            rng = np.random.default_rng([seed, k, crc32(sealed.data.encode())])
            if not twin.play(motion, rng, f"next{k + 1}", runs):
                raise RuntimeError(f"the simulated robot diverges under {motion.name or 'the commands'}")
    return sorted({p.name for p in runs.iterdir()} - before)
