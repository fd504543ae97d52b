"""One case, scored."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from residual_mpc.blind.records import Answer
from residual_mpc.blind.score.claim import Claim, read_claim
from residual_mpc.blind.score.match import Match, counterpart, match
from residual_mpc.blind.score.strict import StrictMatch, strict_match
from residual_mpc.errors import BadInput

_NULL = {"gain": 1.0, "scale": 1.0, "ratio": 1.0}  # parameters whose null value is not 0
_ANGLES = ("heading", "phase")


@dataclass(frozen=True)
class ParameterOutcome:
    """One parameter of an effect that was named at its place."""

    effect: str
    parameter: str
    drawn: float  # planted
    true: float  # the best fit under the library's law, moved towards the estimate as far as the background allows
    value: float
    covers_drawn: bool | None  # None where no interval was given
    covered: bool | None  # likewise of `true`
    relative_error: float  # of the deviation from the null value


@dataclass(frozen=True)
class Outcome:
    """One case: what was hidden, what was claimed, how they compare."""

    name: str
    answer: Answer
    claim: Claim | None  # None where no diagnosis came out: counted as wrong
    match: Match
    parameters: tuple[ParameterOutcome, ...]
    seconds: float | None
    trouble: str  # why there is no diagnosis

    @cached_property
    def strict(self) -> StrictMatch:
        """The comparison without groups, twins and background."""
        return strict_match(self.answer, self.claim, self.match)


def outcome(name: str, answer: Answer, result: Path) -> Outcome:
    """Score the diagnosis in the folder ``result``."""
    seconds, trouble = run_record(result)
    claim: Claim | None = None
    if not trouble:
        try:
            claim = read_claim(result / "diagnosis.json")
        except (BadInput, OSError) as error:
            trouble = str(error)
    if claim is None:
        return Outcome(name, answer, None, Match(False, None, (), 1), (), seconds, trouble)
    return Outcome(name, answer, claim, match(answer, claim), _parameters(answer, claim), seconds, "")


def run_record(result: Path) -> tuple[float | None, str]:
    """(seconds, why there is no answer) of the folder of a case."""
    try:
        record = json.loads((result / "run.json").read_text())
    except (OSError, ValueError):
        return None, "not run"
    return float(record["seconds"]), "" if record["status"] == "done" else str(record["status"])


def _parameters(answer: Answer, claim: Claim) -> tuple[ParameterOutcome, ...]:
    found = []
    best_fit = answer.notes.get("best_fit", {})
    faint = {p.effect for p in answer.background}
    named_more = any(effect in faint for effect, _ in claim.estimates)
    among = answer.notes.get("best_fit_among_background", {}) if named_more else {}
    for planted in answer.effects:
        name = counterpart(planted, answer, claim)
        if name is None:
            continue
        for parameter, drawn in planted.parameters.items():
            estimate = claim.estimates[name].get(parameter)
            if estimate is None:
                continue
            # where the truth follows another law, its best fit under the library's law is what is estimated
            key = f"{planted.effect}.{parameter}"
            true = float(best_fit.get(key, drawn))
            other = float(among.get(key, true))  # with part of the background named, anything in between is right
            true = float(np.clip(estimate.value, min(true, other), max(true, other)))
            null = _NULL.get(parameter, 0.0)
            scale = 1.0 if parameter in _ANGLES else max(abs(true - null), 1e-12)
            covers_drawn, covered = (
                estimate.low <= x <= estimate.high if estimate.low == estimate.low else None for x in (drawn, true)
            )
            error = abs(estimate.value - true) / scale
            found.append(
                ParameterOutcome(planted.effect, parameter, drawn, true, estimate.value, covers_drawn, covered, error)
            )
    return tuple(found)
