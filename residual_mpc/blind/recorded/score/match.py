"""When a comparison is right about a case of recorded runs."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from itertools import product

from residual_mpc.blind.recorded.score.claim import Claim, Name
from residual_mpc.blind.records import Answer, Planted
from residual_mpc.effects.library import BY_NAME

LARGEST_GROUP = 3
MOST_READINGS = 4096
OPEN = ("partial", "unknown")


@dataclass(frozen=True)
class Match:
    """How one claim compares with one answer.

    Attributes:
        right: the set of effects is the planted one, group members exchanged where that makes it so; of a case
            without changes: `same`; where the library lacks a planted effect: `partial` or `unknown` without a wrong
            name.
        strict: as `right`, and by the names that stand in the claim, under the verdict that says no more is left.
        target_right: whether the targets are right too; None where the set is wrong or empty.
        named: by planted effect, whether it is named, groups counted.
        wrong: the names that stand for no planted change.
        reading: the names as they were read.
    """

    right: bool
    strict: bool
    target_right: bool | None
    named: tuple[bool, ...]
    wrong: tuple[Name, ...]
    reading: tuple[Name, ...]


def lacking(answer: Answer) -> tuple[str, ...]:
    """The planted effects that this program's library does not have."""
    return tuple(p.effect for p in answer.effects if p.effect not in BY_NAME)


def match(answer: Answer, claim: Claim) -> Match:
    """Compare: the reading that leaves the fewest wrong names and then the fewest planted effects unnamed counts."""
    planted = {p.effect for p in answer.effects}
    best = min(
        readings(claim, planted),
        key=lambda r: (len(_strange(r, planted)), len(planted - _effects(r)), not _targets_right(answer, r)),
    )
    named = tuple(p.effect in _effects(best) for p in answer.effects)
    wrong = tuple(name for name in best if name[0] not in planted)
    if not answer.effects:
        right = claim.verdict == "same" and not claim.named
        return Match(right, right, None, (), claim.named, claim.named)
    if lacking(answer):
        right = claim.verdict in OPEN and not wrong
        return Match(right, right and not _strange(claim.named, planted), None, named, wrong, best)
    right = claim.verdict in ("changed", "partial") and _effects(best) == planted
    strict = claim.verdict == "changed" and _effects(claim.named) == planted
    return Match(right, strict, _targets_right(answer, best) if right else None, named, wrong, best)


def _effects(reading: Collection[Name]) -> set[str]:
    return {effect for effect, _ in reading}


def _strange(reading: Collection[Name], planted: Collection[str]) -> set[str]:
    return {effect for effect, _ in reading if effect not in planted}


def readings(claim: Claim, planted: Collection[str]) -> Iterator[tuple[Name, ...]]:
    """The names as they stand, then with members of groups of at most three exchanged. A larger group counts where
    all its members but two are planted effects."""
    yield claim.named
    usable = [g for g in claim.groups if _admissible(g, planted)]
    nothing: frozenset[Name] = frozenset()
    options = []
    for group in usable:
        standing = [member for member in group if member <= frozenset(claim.named)]
        options.append([(nothing, nothing), *((s, m) for s in standing for m in group if m != s)])
    for count, picks in enumerate(product(*options)):
        if count >= MOST_READINGS:
            return
        current = set(claim.named)
        for gone, come in picks:
            if not gone <= current:
                break
            current = (current - gone) | come
        else:
            yield tuple(sorted(current, key=str))


def _admissible(group: tuple[frozenset[Name], ...], planted: Collection[str]) -> bool:
    strange = [member for member in group if not _effects(member) <= set(planted)]
    return len(group) <= LARGEST_GROUP or len(strange) < LARGEST_GROUP


def _targets_right(answer: Answer, reading: Collection[Name]) -> bool:
    def claimed(effect: str) -> frozenset[str]:
        return frozenset[str]().union(*(where(answer, *name) for name in reading if name[0] == effect))

    return all(where(answer, p.effect, p.target) == claimed(p.effect) for p in answer.effects)


def where(answer: Answer, effect: str, target: str | None) -> frozenset[str]:
    """The places that ``target`` stands for: null, and `pose` of a sensor, are all of them; a joint is its channel."""
    places = frozenset(_bare(t) for t in answer.notes.get("targets", {}).get(effect, ())) or frozenset({"all"})
    if target is None or _bare(target) == "pose" or target == answer.family:
        return places
    return frozenset({_bare(target)})


def _bare(target: str) -> str:
    return target.removeprefix("position.")


def counterpart(planted: Planted, answer: Answer, claim: Claim) -> Name | None:
    """The name in the claim that stands for ``planted`` by effect and place, if any."""
    wanted = where(answer, planted.effect, planted.target)
    return next((n for n in claim.named if n[0] == planted.effect and where(answer, *n) == wanted), None)
