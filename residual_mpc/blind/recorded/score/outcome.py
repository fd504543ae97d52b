"""One case of recorded runs, scored."""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot
from pathlib import Path

from residual_mpc.blind.recorded.score.claim import Claim, read_claim
from residual_mpc.blind.recorded.score.match import Match, counterpart, match
from residual_mpc.blind.records import Answer, Planted
from residual_mpc.blind.score.outcome import run_record
from residual_mpc.errors import BadInput

RATIOS = ("gain", "scale", "ratio")  # parameters whose change is a ratio: 1 is none
SURE = 0.9


@dataclass(frozen=True)
class SizeOutcome:
    """One parameter of a change that was named at its place. covered: None where no interval was given."""

    effect: str
    parameter: str
    true: float
    value: float
    relative_error: float  # of the size of the whole change
    covered: bool | None


@dataclass(frozen=True)
class Outcome:
    """One case of a source's runs: what was changed, what was claimed, how they compare. claim: None where no
    comparison came out, which is wrong."""

    name: str
    source: str
    answer: Answer
    claim: Claim | None
    match: Match
    sizes: tuple[SizeOutcome, ...]
    seconds: float | None
    trouble: str

    @property
    def surest_wrong(self) -> float | None:
        """The highest probability that was given to an effect that was not changed; None where none was given."""
        if self.claim is None:
            return None
        planted = {p.effect for p in self.answer.effects}
        excused = set(self.claim.named) - set(self.match.reading)  # exchanged for a member of its group
        stated = [
            p for name, p in self.claim.probabilities.items() if name[0] not in planted and name not in excused
        ]  # fmt: skip
        return max(stated, default=None)

    @property
    def visible(self) -> tuple[bool | None, ...]:
        """Of each planted change whether it is larger than the smallest that the runs were said to show; None where
        nothing was said of it."""
        return tuple(None if self.claim is None else _visible(p, self.claim) for p in self.answer.effects)

    @property
    def sure_and_wrong(self) -> bool:
        """Whether the case is wrong and a wrong name was stated at 0.9 or more."""
        return not self.match.right and (self.surest_wrong or 0.0) >= SURE


def outcome(name: str, source: str, answer: Answer, result: Path) -> Outcome:
    """Score the comparison in the folder ``result``."""
    seconds, trouble = run_record(result)
    claim: Claim | None = None
    if not trouble:
        try:
            claim = read_claim(result / "comparison.json")
        except (BadInput, OSError) as error:
            trouble = str(error)
    if claim is None:
        nothing = Match(False, False, None, (False,) * len(answer.effects), (), ())
        return Outcome(name, source, answer, None, nothing, (), seconds, trouble)
    return Outcome(name, source, answer, claim, match(answer, claim), _sizes(answer, claim), seconds, "")


def _visible(planted: Planted, claim: Claim) -> bool | None:
    for name in ((planted.effect, planted.target), (planted.effect, None)):
        for parameter, least in claim.visible.get(name, {}).items():
            if parameter in planted.parameters:
                return abs(planted.parameters[parameter] - (parameter in RATIOS)) >= least
    return None


def _sizes(answer: Answer, claim: Claim) -> tuple[SizeOutcome, ...]:
    found = []
    for planted in answer.effects:
        name = counterpart(planted, answer, claim)
        if name is None:
            continue
        size = hypot(*(true - (parameter in RATIOS) for parameter, true in planted.parameters.items()))
        for parameter, true in planted.parameters.items():
            estimate = claim.estimates[name].get(parameter)
            if estimate is None:
                continue
            inside = None if estimate.interval is None else estimate.interval[0] <= true <= estimate.interval[1]
            error = abs(estimate.value - true) / max(size, 1e-12)
            found.append(SizeOutcome(planted.effect, parameter, true, estimate.value, error, inside))
    return tuple(found)
