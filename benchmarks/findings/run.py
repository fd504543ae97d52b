"""Runs the command line on a case, in a process of its own; what was measured before is read."""

from __future__ import annotations

import hashlib
import json
import shlex
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path
from time import perf_counter
from typing import Any

from benchmarks.findings.records import Case

LONGEST = 3 * 3600.0  # s, after which a diagnosis is stopped


@dataclass(frozen=True)
class Places:
    """Where the cases and results lie, and the shared folders of cases and recorded robots."""

    out: Path
    shared_cases: Path
    shared_data: Path

    def case(self, case: Case) -> Path:
        """The folder of the case."""
        return self.out / "cases" / case.name

    def result(self, case: Case) -> Path:
        """The folder of what was said of it."""
        return self.out / "results" / case.name


@dataclass(frozen=True)
class Program:
    """The command line that is called, and what tells one version of it from another."""

    path: Path
    version: str


@dataclass(frozen=True)
class Outcome:
    """What `diagnose` printed (None where it failed), its seconds, and the share of the gap closed on new motions."""

    case: Case
    truth: dict[str, Any] | None
    document: dict[str, Any] | None
    seconds: float = 0.0
    closed: float | None = None
    trouble: str = ""


def program_at(path: Path) -> Program:
    """The program with its version: what it prints, and the state of its checkout where it runs from one."""
    said = _text([str(path), "--version"])
    where = _text([str(path.parent / "python"), "-P", "-c", "import residual_mpc as m; print(m.__file__)"])
    if not where:
        return Program(path, said)
    git = ["git", "-C", str(Path(where).parents[1])]
    code = ("--", "residual_mpc", "plants")
    commit = _text([*git, "log", "-1", "--format=%h", *code])
    changes = _text([*git, "diff", "HEAD", *code])
    digest = f" changed {hashlib.sha256(changes.encode()).hexdigest()[:8]}" if changes else ""
    return Program(path, f"{said} {commit}{digest}".strip())


def _text(words: Sequence[str]) -> str:
    """What a command prints; empty where it fails or is absent."""
    try:
        done = subprocess.run(words, capture_output=True, text=True, check=False)
    except OSError:
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""


def made(case: Case, places: Places, again: bool = False) -> str:
    """Make the case's folder unless it exists (or `again`); why not, where it needs what is absent."""
    folder = places.case(case)
    if case.data is not None and not (places.shared_data / case.data).is_dir():
        return f"{places.shared_data / case.data} is absent"
    if again or not (folder / "truth.json").is_file():  # the last file that a maker writes
        folder.mkdir(parents=True, exist_ok=True)
        case.make(folder, places.shared_data)
    return ""


def runs_of(case: Case, places: Places) -> tuple[list[Path], list[Path]]:
    """The runs to diagnose, and those that judge the result."""
    own = sorted([*places.case(case).glob("run*.csv.gz"), *places.case(case).glob("run*.parquet")])
    if own or case.data is None:
        return own, []
    every = sorted((places.shared_data / case.data).glob("*.parquet"))
    chosen = [run for run in every if any(fnmatch(run.stem, pattern) for pattern in case.motions)]
    return chosen, [run for run in every if run not in chosen] if case.judged else []


def outcome(case: Case, places: Places, program: Program, again: bool = False) -> Outcome:
    """Diagnose the case, or read what this program said of it before."""
    trouble = made(case, places, again)
    if trouble:
        return Outcome(case, None, None, trouble=trouble)
    truth = json.loads((places.case(case) / "truth.json").read_text(encoding="utf-8"))
    runs, judges = runs_of(case, places)
    out = places.result(case)
    robot = ["--robot", str(places.case(case) / "robot.toml")]
    words = ["diagnose", *robot, *map(str, runs), *case.options, "--out", str(out), "--json"]
    key = {"program": program.version, "command": shlex.join(words)}
    kept = out / "outcome.json"
    if kept.is_file() and not again:
        was = json.loads(kept.read_text(encoding="utf-8"))
        if all(was[name] == value for name, value in key.items()):
            return Outcome(case, truth, was["document"], was["seconds"], was["closed"], was["trouble"])
    begin = perf_counter()
    document, trouble = called(program, words, out)
    seconds = perf_counter() - begin
    closed = None
    if document is not None and judges:
        gap = ["gap", *robot, *map(str, judges), "--model", str(out / "diagnosis.json"), "--json"]
        measured, trouble = called(program, gap, out)
        closed = None if measured is None else 1 - measured["model"] / measured["nominal"]
    said = brief(document)
    new = {**key, "document": said, "seconds": seconds, "closed": closed, "trouble": trouble}
    kept.write_text(json.dumps(new, indent=1) + "\n", encoding="utf-8")
    return Outcome(case, truth, said, seconds, closed, trouble)


def called(program: Program, words: Sequence[str], out: Path) -> tuple[dict[str, Any] | None, str]:
    """What the program printed, or why it printed nothing; its log goes to `out`."""
    out.mkdir(parents=True, exist_ok=True)
    with (out / f"{words[0]}.log").open("w", encoding="utf-8") as log:
        try:
            done = subprocess.run(
                [str(program.path), *words], stdout=subprocess.PIPE, stderr=log, text=True, check=False, timeout=LONGEST
            )
        except subprocess.TimeoutExpired:
            return None, f"stopped after {LONGEST:.0f} s"
    if done.returncode:
        lines = (out / f"{words[0]}.log").read_text(encoding="utf-8").strip().splitlines()
        return None, f"exit status {done.returncode}: {lines[-1] if lines else ''}"
    printed: dict[str, Any] = json.loads(done.stdout)
    return printed.get(words[0], printed), ""


def brief(document: dict[str, Any] | None) -> dict[str, Any] | None:
    """The parts of diagnosis.json that are scored and shown."""
    wanted = ("verdict", "explanation", "confounded", "gap", "shrink", "unexplained", "horizons")
    return None if document is None else {name: document[name] for name in wanted if name in document}
