"""Score the diagnoses of a suite against its revealed answers."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from residual_mpc.blind.score.explained import Explained, answer_of, read_explained
from residual_mpc.blind.score.openings import Opening, read_openings, record_opening
from residual_mpc.blind.score.outcome import outcome
from residual_mpc.blind.score.resolved import ExperimentScores, score_experiments
from residual_mpc.blind.score.summary import Summary, summarise
from residual_mpc.blind.seal import reveal
from residual_mpc.blind.suite import Suite, program_version, read_suite
from residual_mpc.errors import BadInput


@dataclass(frozen=True)
class Scores:
    """Every method's figures on one suite."""

    suite: Suite
    summaries: tuple[Summary, ...]  # the product first, then the baselines
    openings: tuple[Opening, ...]
    version: str
    experiments: ExperimentScores | None = None  # of the first method, where they were carried out
    explained: tuple[Explained, ...] = ()  # its wrong answers, where `blind explain` looked at them


def score_suite(
    folder: Path,
    answers: Path,
    results: Mapping[str, Path],
    ledger: Path,
    experiments: Path | None = None,
    explained: Path | None = None,
) -> Scores:
    """Reveal the answers, check every commitment, and score each method's ``results`` (name to folder).

    ``experiments`` and ``explained``: the folders of `blind experiment` and `blind explain`, of the first method's
    diagnoses. Opening the answers of a suite of test seeds is written to ``ledger`` first.
    """
    suite = read_suite(folder)
    for name, place in results.items():
        if not place.is_dir():
            raise BadInput(
                f"this folder contains no diagnoses of {name}", str(place), "run `residual-mpc blind run` first"
            )
    version = program_version()
    if suite.seeds == "test":
        ran = sorted({v for place in results.values() for v in _versions(place)})
        record_opening(ledger, ", ".join(ran) or version, _identity(suite), len(suite.cases))
    revealed = {e.name: reveal(answers / f"{e.name}.json", e.commitment, suite.case(e)) for e in suite.cases}
    summaries = tuple(
        summarise(method, [outcome(name, answer, place / name) for name, answer in revealed.items()])
        for method, place in results.items()
    )
    first = next(iter(results.values()))
    settled = None if experiments is None else score_experiments(revealed, first, experiments)
    why = () if explained is None else _explained(explained, summaries[0])
    return Scores(suite, summaries, read_openings(ledger), version, settled, why)


def _explained(folder: Path, of: Summary) -> tuple[Explained, ...]:
    """What ``folder`` says of the wrong answers of a method. Raises BadInput where it is of other answers."""
    found = read_explained(folder)
    wrong = [(o.name, *answer_of(o)) for o in of.outcomes if not o.match.right]
    if wrong != [(e.case, e.said, e.named) for e in found]:
        raise BadInput(
            f"the explained answers are not the wrong answers of {of.method}",
            str(folder),
            "run `residual-mpc blind explain` on the results of the first method, into a new folder",
        )
    return found


def _identity(suite: Suite) -> str:
    return hashlib.sha256("".join(sorted(e.commitment for e in suite.cases)).encode()).hexdigest()[:12]


def _versions(results: Path) -> set[str]:
    return {str(json.loads(path.read_text()).get("version")) for path in results.glob("*/run.json")}
