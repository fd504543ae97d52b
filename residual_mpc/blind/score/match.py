"""When an answer is right: the contract's rule for sets, groups, twins, background and targets."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from itertools import product

from residual_mpc.blind.records import Answer, Planted
from residual_mpc.blind.score.claim import Claim, Name
from residual_mpc.effects.library import BY_NAME
from residual_mpc.effects.sensor import SENSOR_BIAS

_LARGEST_GROUP = 3
_LACKING = ("unknown", "partial")
_LAWS = frozenset({"fitted_law"})  # claims no name
_MOST_READINGS = 4096


@dataclass(frozen=True)
class Match:
    """How one claim compares with one answer."""

    right: bool
    target_right: bool | None  # None where the set is wrong or there is none
    reading: tuple[Name, ...]  # the explanation, group members exchanged where that made it right
    group_size: int  # members of the largest group that was needed; 1: none


def match(answer: Answer, claim: Claim) -> Match:
    """Compare. Where the library lacks the only cause, and where there is no gap, the verdict alone counts, unless
    something is in the background."""
    faint = {p.effect for p in answer.background}
    if answer.withheld or (answer.unknown and not answer.effects and not faint):
        return Match(claim.verdict in _LACKING, None, claim.named, 1)
    if not answer.effects:
        return _without_effects(answer, claim)
    if answer.unknown:
        if claim.verdict not in _LACKING:
            return Match(False, None, claim.named, 1)
        faint |= _LAWS
    wanted = {p.effect for p in answer.effects}
    best: Match | None = None
    for reading, size in readings(claim, answer):
        names = {effect for effect, _ in reading}
        if not (wanted <= names <= wanted | faint):
            continue
        found = Match(True, _targets_right(answer, reading), reading, size)
        if best is None or (found.target_right, -found.group_size) > (best.target_right, -best.group_size):
            best = found
    return best or Match(False, None, claim.named, 1)


def _without_effects(answer: Answer, claim: Claim) -> Match:
    """No effect has to be named. Beside an unknown cause, doubt is right, and so is `effects` if all that is named
    changes; without one, `no_gap`, and `effects` that names what is in the background. Nothing else may be named."""
    faint = {p.effect for p in answer.background}
    if answer.unknown:
        doubted = claim.verdict in _LACKING
        fine = doubted or (claim.verdict == "effects" and set(claim.named) <= claim.changing)
        allowed = faint | _LAWS if doubted else faint
    else:
        fine, allowed = claim.verdict == "no_gap" or (claim.verdict == "effects" and bool(claim.named)), faint
    for reading, size in readings(claim, answer):
        if fine and {effect for effect, _ in reading} <= allowed:
            return Match(True, None, reading, size)
    return Match(False, None, claim.named, 1)


def readings(claim: Claim, answer: Answer) -> Iterator[tuple[tuple[Name, ...], int]]:
    """The explanation as it stands, then with members of groups exchanged, and the largest group used."""
    yield claim.named, 1
    twins = {name for group in answer.twins for name in group}
    true = {p.effect for p in answer.effects}
    usable = [group for group in claim.groups if _admissible(group, twins | true)]
    options: list[list[tuple[frozenset[Name], frozenset[Name], int]]] = []
    named = frozenset(claim.named)
    for group in usable:
        standing = [m for m in group if m <= named]
        nothing: frozenset[Name] = frozenset()
        choices = [(nothing, nothing, 1)]
        choices += [(s, m, len(group)) for s in standing for m in group if m != s]
        options.append(choices)
    for count, picks in enumerate(product(*options)):
        if count >= _MOST_READINGS:
            return
        if all(not gone for gone, _, _ in picks):
            continue
        current, size = set(named), 1
        for gone, come, members in picks:
            if not gone <= current:
                break
            current, size = (current - gone) | come, max(size, members)
        else:
            yield tuple(sorted(current, key=str)), size


def _admissible(group: Sequence[frozenset[Name]], expected: Collection[str]) -> bool:
    """At most three members, not counting those that a known twin explains."""
    strange = [member for member in group if not all(effect in expected for effect, _ in member)]
    return len(group) <= _LARGEST_GROUP or len(strange) < _LARGEST_GROUP - 1


def _targets_right(answer: Answer, reading: Sequence[Name]) -> bool:
    for planted in answer.effects:
        named = [target for effect, target in reading if effect == planted.effect]
        faint = [p.target for p in answer.background if p.effect == planted.effect]
        true = where(answer, planted.effect, planted.target)
        claimed = frozenset[str]().union(*(where(answer, planted.effect, t) for t in named))
        allowed = true.union(*(where(answer, planted.effect, t) for t in faint))
        if not true <= claimed <= allowed:
            return False
    return True


def where(answer: Answer, effect: str, target: str | None) -> frozenset[str]:
    """The places that ``target`` of ``effect`` stands for: null is all of them."""
    places = _places(answer, effect)
    if target is None or (target == "pose" and _of_sensor(effect)):
        return places
    if _of_sensor(effect) and f"position.{target}" in places:
        return frozenset({f"position.{target}"})
    return frozenset({target})


def _places(answer: Answer, effect: str) -> frozenset[str]:
    joints = int(answer.notes.get("joints", 0))
    names: tuple[str, ...] = tuple(answer.notes.get("names", ()))  # of actuators that are not numbered
    drives = answer.family == "wheeled" or "wheeled" in answer.traits
    if _of_sensor(effect):
        if drives:
            return frozenset({"pose.theta"} if effect == SENSOR_BIAS.name else {"pose.x", "pose.y", "pose.theta"})
        return frozenset(f"position.{name}" for name in names or (f"j{i + 1}" for i in range(joints)))
    if drives:
        return frozenset({"left", "right"})
    if names:
        return frozenset(names)
    prefix = "link" if effect in BY_NAME and BY_NAME[effect].target == "body" else "j"
    return frozenset(f"{prefix}{i + 1}" for i in range(joints))


def _of_sensor(effect: str) -> bool:
    """Whether it is a sensor's; an answer may name effects that are not installed here."""
    return effect in BY_NAME and BY_NAME[effect].stage == "sensor"


def counterpart(planted: Planted, answer: Answer, claim: Claim) -> Name | None:
    """The named effect that stands for ``planted`` by the same name and place, if any."""
    for name in claim.named:
        if name[0] == planted.effect and where(answer, *name) == where(answer, planted.effect, planted.target):
            return name
    return None
