"""One answer by the strict rule: what the explanation itself names, without groups, twins or background effects."""

from __future__ import annotations

from dataclasses import dataclass

from residual_mpc.blind.records import Answer
from residual_mpc.blind.score.claim import Claim, Name
from residual_mpc.blind.score.match import Match, where

SURE = 0.9  # a probability from which on an answer counts as stated beyond doubt
LIKELY = 0.5  # a probability above which an effect is stated as likelier than not
_NO_NAME = "fitted_law"  # turns what is left into a law, and names no cause


@dataclass(frozen=True)
class StrictMatch:
    """How one explanation compares with one answer, as it stands.

    exact: the set of effects is the planted one; where the library lacks the cause, `unknown`, or `partial` without a
    wrong name; without a gap, `no_gap`. exact_targets: and every effect is at its place; None where it is not exact
    or nothing is to be found. planted: every effect to find and how it was found: "named", "group" (only by an
    exchange with a member of a group that the lenient rule allows) or "missed". extra: named effects that are not
    planted, of the background or not. wrong: those of them that the robot does not have at all. stated: the largest
    probability of a wrong named effect; None where there is none.
    """

    exact: bool
    exact_targets: bool | None
    planted: tuple[tuple[str, str], ...]
    extra: tuple[str, ...]
    wrong: tuple[str, ...]
    stated: float | None


def strict_match(answer: Answer, claim: Claim | None, lenient: Match) -> StrictMatch:
    """Compare; without a claim everything is missed."""
    wanted = to_find(answer)
    if claim is None:
        return StrictMatch(False, None, tuple((e, "missed") for e in wanted), (), (), None)
    named = list(dict.fromkeys(effect for effect, _ in claim.named if effect != _NO_NAME or wanted))
    extra = tuple(effect for effect in named if effect not in wanted)
    wrong = tuple(effect for effect in extra if not _faint(answer, effect))
    if wanted:
        exact = set(named) == set(wanted)
    elif answer.unknown or answer.withheld:
        exact = claim.verdict in ("unknown", "partial") and not wrong
    else:
        exact = claim.verdict == "no_gap" and not named
    exchanged = {effect for effect, _ in lenient.reading} if lenient.right else set()
    planted = tuple((e, "named" if e in named else "group" if e in exchanged else "missed") for e in wanted)
    stated = [p for (effect, _), p in claim.probabilities.items() if effect in wrong]
    return StrictMatch(
        exact=exact,
        exact_targets=_targets(answer, claim) if exact and wanted else None,
        planted=planted,
        extra=extra,
        wrong=wrong,
        stated=max(stated, default=None),
    )


def to_find(answer: Answer) -> tuple[str, ...]:
    """The planted effects that the library holds; none where it lacks the cause."""
    return () if answer.withheld else tuple(dict.fromkeys(p.effect for p in answer.effects))


def statements(answer: Answer, claim: Claim) -> list[tuple[Name, float, bool]]:
    """(effect and target, stated probability, whether it is planted there) of all candidates; none is left out, and
    an effect of the background counts as not planted. A part of the planted place, such as one wheel of two, is true
    where it is named: as a candidate it is a rival of the whole."""
    return [(name, p, _planted_at(answer, name, name in claim.named)) for name, p in claim.probabilities.items()]


def stated_as_sure(answer: Answer, claim: Claim) -> list[tuple[bool, bool]]:
    """Of each named effect that is stated at `SURE` or more: whether the robot has it (planted there, in the
    background, or in a reported group with an effect that is planted), and whether it is planted there itself."""
    out = []
    for name in claim.named:
        if name[0] == _NO_NAME or claim.probabilities.get(name, 0.0) < SURE:
            continue
        planted = _planted_at(answer, name, True)
        out.append((planted or _faint(answer, name[0]) or _beside_planted(answer, claim, name), planted))
    return out


def _beside_planted(answer: Answer, claim: Claim, name: Name) -> bool:
    groups = (g for g in claim.groups if any(name in member for member in g))
    return any(all(_planted_at(answer, n, True) for n in member) for g in groups for member in g)


def surest_wrong(answer: Answer, claim: Claim) -> tuple[Name, float] | None:
    """The most probable candidate, named or not, that the robot does not have."""
    there = {*to_find(answer), *(p.effect for p in answer.background), _NO_NAME}
    wrong = [(name, p) for name, p in claim.probabilities.items() if name[0] not in there]
    return max(wrong, key=lambda one: one[1], default=None)


def _planted_at(answer: Answer, name: Name, named: bool) -> bool:
    effect, target = name
    if effect not in to_find(answer):
        return False
    claimed = where(answer, effect, target)
    places = [where(answer, effect, p.target) for p in answer.effects if p.effect == effect]
    return any(claimed == place or (named and claimed <= place) for place in places)


def _targets(answer: Answer, claim: Claim) -> bool:
    nowhere = frozenset[str]()
    return all(
        nowhere.union(*(where(answer, effect, t) for e, t in claim.named if e == effect))
        == nowhere.union(*(where(answer, effect, p.target) for p in answer.effects if p.effect == effect))
        for effect in to_find(answer)
    )


def _faint(answer: Answer, effect: str) -> bool:
    return any(p.effect == effect for p in answer.background)
