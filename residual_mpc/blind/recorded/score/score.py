"""Score the comparisons of suites of recorded runs against their revealed answers."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from residual_mpc.blind.recorded.score.outcome import Outcome, outcome
from residual_mpc.blind.recorded.score.summary import Summary, summarise
from residual_mpc.blind.score.openings import Opening, read_openings, record_opening
from residual_mpc.blind.seal import reveal
from residual_mpc.blind.suite import Suite, program_version, read_suite
from residual_mpc.errors import BadInput


@dataclass(frozen=True)
class RecordedScores:
    """Every method's figures on the same cases."""

    suites: tuple[Suite, ...]
    summaries: tuple[Summary, ...]
    openings: tuple[Opening, ...]
    version: str


@dataclass(frozen=True)
class Swept:
    """A suite, its sealed answers, and each method's results (name to folder); source: what to call its runs."""

    folder: Path
    answers: Path
    results: Mapping[str, Path]
    source: str = ""  # empty: the robot's name


def score_recorded(swept: Sequence[Swept], ledger: Path) -> RecordedScores:
    """Reveal the answers, check every commitment, and score each method over all suites together.

    Opening the answers of test seeds is written to ``ledger`` first.
    """
    found: dict[str, list[Outcome]] = {}
    suites = [read_suite(one.folder) for one in swept]
    for one, suite in zip(swept, suites, strict=True):
        for name, place in one.results.items():
            if not place.is_dir():
                raise BadInput(
                    f"this folder contains no comparisons of {name}", str(place), "run `residual-mpc blind run` first"
                )
        if suite.seeds == "test":
            _record(ledger, suite, one.results)
        for entry in suite.cases:
            answer = reveal(one.answers / f"{entry.name}.json", entry.commitment, suite.case(entry))
            source = one.source or answer.family
            for method, place in one.results.items():
                found.setdefault(method, []).append(outcome(entry.name, source, answer, place / entry.name))
    summaries = tuple(summarise(method, outcomes) for method, outcomes in found.items())
    return RecordedScores(tuple(suites), summaries, read_openings(ledger), program_version())


def _record(ledger: Path, suite: Suite, results: Mapping[str, Path]) -> None:
    records = [path for place in results.values() for path in place.glob("*/run.json")]
    versions = sorted({str(json.loads(path.read_text()).get("version")) for path in records})
    identity = hashlib.sha256("".join(sorted(e.commitment for e in suite.cases)).encode()).hexdigest()[:12]
    record_opening(ledger, ", ".join(versions) or program_version(), identity, len(suite.cases))
