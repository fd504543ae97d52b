"""Diagnose the wrong answers of a suite again, with the planted effects as the only candidates.

This needs the answers, so it comes after scoring: it says why an answer was wrong, and its diagnoses count nowhere.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from residual_mpc.blind.explain.truth_gaps import GapOverHorizons, measure_truth_gaps
from residual_mpc.blind.run import diagnose_case
from residual_mpc.blind.score.claim import Claim
from residual_mpc.blind.score.explained import EXPLAINED, Explained, answer_of, explained_from, faults
from residual_mpc.blind.score.outcome import Outcome, outcome
from residual_mpc.blind.score.score import score_suite
from residual_mpc.blind.suite import Entry, read_suite, write_json
from residual_mpc.errors import BadInput
from residual_mpc.processes.isolated import program
from residual_mpc.processes.parallel import Progress, run_in_parallel, silent

_RECORD = "explained.json"
_MARGIN = 0.1  # by which a fit's gap must exceed the truth's: less is within the noise of the held-out windows


@dataclass(frozen=True)
class ExplainSettings:
    """How to diagnose again; ``command`` is a program that takes the options of `residual-mpc diagnose`."""

    command: str = ""  # empty: this installation's own
    jobs: int = -1  # cases at once; -1: all cores
    timeout: float = 600.0  # s a case
    seed: int = 0  # handed to every diagnosis

    def __post_init__(self) -> None:
        if self.timeout <= 0:
            raise BadInput(f"must be > 0 s, got {self.timeout}", "--timeout")


@dataclass(frozen=True)
class ExplainSummary:
    """The wrong answers of ``cases`` cases; resumed: explained by an earlier call."""

    cases: int
    wrong: tuple[Explained, ...]
    resumed: int


def explain_suite(
    folder: Path, answers: Path, results: Path, out: Path, ledger: Path, settings: ExplainSettings,
    progress: Progress = silent,
) -> ExplainSummary:  # fmt: skip
    """Explain every wrong answer in ``results`` into ``out``; answers that it holds already are left as they are.

    Raises BadInput while a case of the suite is not diagnosed: its answer has to stay sealed until then. For a suite
    of test seeds this is an opening, and is written to ``ledger``.
    """
    from joblib import delayed

    suite = read_suite(folder)
    waiting = [e.name for e in suite.cases if not (results / e.name / "run.json").exists()]
    if waiting:
        raise BadInput(
            f"{len(waiting)} of {len(suite.cases)} cases are not diagnosed yet, such as {waiting[0]}",
            str(results),
            "finish `residual-mpc blind run`: the answers stay sealed until then",
        )
    command = [*program(settings.command, "diagnose"), "--seed", str(settings.seed)]
    outcomes = score_suite(folder, answers, {"diagnose": results}, ledger).summaries[0].outcomes
    entries = {e.name: e for e in suite.cases}
    wrong = [o for o in outcomes if not o.match.right]
    out.mkdir(parents=True, exist_ok=True)
    todo = [o for o in wrong if _kept(o, out / o.name) is None]
    calls = (
        delayed(_one)(o, entries[o.name], suite.case(entries[o.name]).resolve(), results / o.name,
                      (out / o.name).resolve(), command, settings.timeout)
        for o in todo
    )  # fmt: skip
    run_in_parallel(calls, [o.name for o in todo], progress, n_jobs=settings.jobs)
    found = tuple(e for o in wrong if (e := _kept(o, out / o.name)) is not None)
    document = {"cases": len(outcomes), "faults": faults(found), "wrong": [e.document() for e in found]}
    write_json(out / EXPLAINED, {"explain": document})
    return ExplainSummary(len(outcomes), found, len(wrong) - len(todo))


def _kept(o: Outcome, out: Path) -> Explained | None:
    """What ``out`` holds of this answer; None where it holds nothing, or another answer to the same case."""
    try:
        found = explained_from(json.loads((out / _RECORD).read_text()))
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return found if answer_of(o) == (found.said, found.named) else None


def _one(o: Outcome, entry: Entry, case: Path, first: Path, out: Path, command: list[str], timeout: float) -> None:
    """Explain one answer into ``out``."""
    gaps: Mapping[str, GapOverHorizons] = {}
    only: Claim | None = None
    trouble = ""
    if o.answer.unknown or o.answer.withheld or not o.answer.effects:
        fault = _without_a_name(o)
        out.mkdir(parents=True, exist_ok=True)
    else:
        effects = dict.fromkeys(p.effect for p in o.answer.effects)
        diagnose_case(case, entry, out, [*command, *(w for e in effects for w in ("--only", e))], timeout)
        again = outcome(o.name, o.answer, out)
        only, trouble, right = again.claim, again.trouble, again.match.right
        if only is None:
            fault = "failed"
        else:
            try:
                said = None if o.claim is None else first / "diagnosis.json"
                gaps = measure_truth_gaps(case, o.answer, said, out / "diagnosis.json")
            except BadInput as error:  # runs or effects that cannot be measured here; the answer is still explained
                trouble = str(error)
            fault = "search" if right else fault_of(gaps)
    explained = Explained(
        case=o.name,
        family=o.answer.family,
        level=o.answer.level,
        seed=o.answer.seed,
        planted=tuple((p.effect, p.target) for p in o.answer.effects) or tuple((c, None) for c in o.answer.unknown),
        said=answer_of(o)[0],
        named=answer_of(o)[1],
        only=None if only is None else only.verdict,
        only_named=() if only is None else only.named,
        gaps=_headline(gaps),
        fault=fault,
        trouble=trouble,
    )
    write_json(out / _RECORD, explained.document())  # last: its presence says that the answer is explained


def fault_of(gaps: Mapping[str, GapOverHorizons]) -> str:
    """The kind of fault of an answer that stays wrong with the planted effects alone."""
    truths = [gaps[name] for name in ("drawn", "best fit") if name in gaps]
    if not truths:
        return "not measured"
    truth = min(truths, key=lambda gap: gap.total)
    if all(gap.large for gap in truths):
        whole = gaps.get("with background")
        return "model" if whole is None or whole.large else "background"
    return "fit" if gaps["only"].worse_than(truth, _MARGIN) else "judgement"


def _without_a_name(o: Outcome) -> str:
    """The kind of fault where no effect of the library was to be found."""
    if o.claim is None:
        return "failed"
    if not (o.answer.unknown or o.answer.withheld):
        return "false alarm"
    return "unseen" if o.claim.verdict == "no_gap" else "stand-in"


def _headline(gaps: Mapping[str, GapOverHorizons]) -> dict[str, float]:
    floor = {"noise floor": gaps["nominal"].noise_floor} if gaps else {}
    return {**floor, **{name: gap.total for name, gap in gaps.items()}}
