"""What experiments settled: of the groups and close rivals of the first diagnoses, how many came apart rightly."""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from residual_mpc.blind.records import Answer
from residual_mpc.blind.score.claim import Claim, Name, read_claim
from residual_mpc.blind.score.match import match, where
from residual_mpc.blind.score.rates import Rate, rate
from residual_mpc.blind.suite import NOTHING_OPEN, RECORD
from residual_mpc.errors import BadInput

RESOLVED, STAYED, WRONG, FAILED = "resolved", "stayed", "became wrong", "failed"
Member = frozenset[Name]


@dataclass(frozen=True)
class Question:
    """What one first diagnosis left open, and what became of it: two or more members of which the data could not say
    which is there. confounded: a group; else a close rival of the explanation. holds: whether one of them is really
    there: where none is, no experiment can show which."""

    case: str
    answer: Answer
    members: tuple[Member, ...]
    confounded: bool
    holds: bool
    outcome: str
    trouble: str = ""


@dataclass(frozen=True)
class ExperimentScores:
    """Every figure of one sweep of experiments. groups_holding, rivals_holding: of these, where one of the members is
    really there. right_before, right_after: of the cases in which one was carried out; named_after: answers right as
    they stand, without exchanging members of groups; lacking: the same two where the library lacks the cause."""

    questions: tuple[Question, ...]
    groups: Rate
    groups_holding: Rate
    rivals: Rate
    rivals_holding: Rate
    by_effects: Mapping[str, Rate]
    stayed: Rate
    became_wrong: Rate
    failed: Rate
    right_before: Rate
    right_after: Rate
    named_after: Rate
    lacking_before: Rate
    lacking_after: Rate

    def document(self) -> dict[str, Any]:
        """As score.json has it, under `experiments`."""
        figures = ("groups", "groups_holding", "rivals", "rivals_holding", "stayed", "became_wrong", "failed",
                   "right_before", "right_after", "named_after", "lacking_before", "lacking_after")  # fmt: skip
        return {
            **{name: getattr(self, name).document() for name in figures},
            "by_effects": {name: r.document() for name, r in self.by_effects.items()},
            "open": [
                {"case": q.case, "level": q.answer.level, "outcome": q.outcome, "trouble": q.trouble,
                 "members": [sorted([list(n) for n in m], key=str) for m in q.members]}
                for q in self.questions if q.outcome != RESOLVED
            ],
        }  # fmt: skip


def score_experiments(answers: Mapping[str, Answer], results: Path, out: Path) -> ExperimentScores:
    """answers: by case; results: of the first diagnoses; out: of `blind experiment`."""
    questions: list[Question] = []
    right: list[tuple[bool, bool, bool, bool]] = []  # before, after, named after, whether the library lacks the cause
    for name, answer in answers.items():
        record = _record(out / name)
        if record["status"] == NOTHING_OPEN:
            continue
        document = json.loads((results / name / "diagnosis.json").read_text())
        first = read_claim(results / name / "diagnosis.json")
        again = _again(out / name)
        trouble = "" if again is not None else str(record["status"])
        found = None if again is None else match(answer, again)
        after = found is not None and found.right
        named = found is not None and again is not None and found.right and found.reading == again.named
        right.append((match(answer, first).right, after, named, _lacking(answer)))
        for members, confounded in _open(document, first):
            wrong = [m for m in members if not _true(answer, m)]
            if wrong:
                outcome = FAILED if again is None else _outcome(wrong, again, after)
                holds = len(wrong) < len(members)
                questions.append(Question(name, answer, members, confounded, holds, outcome, trouble))
    groups, rivals = ([q for q in questions if q.confounded is kind] for kind in (True, False))
    return ExperimentScores(
        questions=tuple(questions),
        groups=rate(q.outcome == RESOLVED for q in groups),
        groups_holding=rate(q.outcome == RESOLVED for q in groups if q.holds),
        rivals=rate(q.outcome == RESOLVED for q in rivals),
        rivals_holding=rate(q.outcome == RESOLVED for q in rivals if q.holds),
        by_effects={
            n: rate(q.outcome == RESOLVED for q in groups if _named(q) == n)
            for n in sorted({_named(q) for q in groups})
        },
        stayed=rate(q.outcome == STAYED for q in groups),
        became_wrong=rate(q.outcome == WRONG for q in groups),
        failed=rate(q.outcome == FAILED for q in groups),
        right_before=rate(b for b, _, _, _ in right),
        right_after=rate(a for _, a, _, _ in right),
        named_after=rate(n for _, _, n, lacking in right if not lacking),
        lacking_before=rate(b for b, _, _, lacking in right if lacking),
        lacking_after=rate(a for _, a, _, lacking in right if lacking),
    )


def _record(case: Path) -> dict[str, Any]:
    try:
        record: dict[str, Any] = json.loads((case / RECORD).read_text())
    except (OSError, ValueError):
        raise BadInput(
            "this folder contains no experiment", str(case), "run `residual-mpc blind experiment` first"
        ) from None
    return record


def _again(case: Path) -> Claim | None:
    """The claim after the experiment; None where none was made."""
    path = case / "again" / "diagnosis.json"
    return read_claim(path) if path.exists() else None


def _open(document: Mapping[str, Any], claim: Claim) -> list[tuple[tuple[Member, ...], bool]]:
    """(members, whether they are a group) of all that a diagnosis leaves open."""

    def terms(parts: Sequence[Mapping[str, Any]]) -> Member:
        return frozenset((str(t["effect"]), t.get("target")) for t in parts)

    close = [a for a in document.get("alternatives") or () if not a.get("confounded", True)]
    pairs = {(terms(a["instead_of"]), terms(a["effects"])) for a in close}
    return [(g, True) for g in claim.groups] + [(pair, False) for pair in sorted(pairs, key=str)]


def _outcome(wrong: Collection[Member], again: Claim, right: bool) -> str:
    """right: whether the second answer is."""
    if not right:
        return WRONG
    named = frozenset(again.named)
    still = any(m <= named or any(m in group for group in again.groups) for m in wrong)
    return STAYED if still else RESOLVED


def _true(answer: Answer, member: Member) -> bool:
    """Whether every effect of a member is really there, a faint one included."""
    return all(_present(answer, *name) for name in member)


def _present(answer: Answer, effect: str, target: str | None) -> bool:
    planted = [p for p in answer.effects if p.effect == effect]
    if answer.withheld:
        return False
    faint = any(p.effect == effect for p in answer.background)
    return faint or any(where(answer, effect, target) == where(answer, effect, p.target) for p in planted)


def _lacking(answer: Answer) -> bool:
    return bool(answer.unknown or answer.withheld)


def _named(q: Question) -> str:
    return ", ".join(dict.fromkeys(sorted({effect for member in q.members for effect, _ in member})))
