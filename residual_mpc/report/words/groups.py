"""Groups of effects that cannot be told apart, in words."""

from collections.abc import Mapping, Sequence
from typing import Any

from residual_mpc.effects.library import BY_NAME
from residual_mpc.report.words.effects import name, name_at
from residual_mpc.report.words.numbers import listed

LIKELIER = 2.0  # times the probability of a group's named member, from which another is worth a word
DOUBTED = 0.9  # probability below which the other members are named beside an effect
LIKELY, MOST = 0.5, 0.97  # probabilities of a group, from which it is stated and the largest
LISTED = 3  # other members named beside an effect; more are counted

Member = Mapping[str, Any] | Sequence[Mapping[str, Any]]  # several act together


def effects_of(member: Member) -> list[Mapping[str, Any]]:
    """A member as the list of its effects."""
    return [member] if isinstance(member, Mapping) else list(member)


def member_name(member: Member) -> str:
    """ "backlash (elbow) together with Stribeck friction (elbow)"."""
    return " together with ".join(
        name(effect) + (f" ({effect['target']})" if effect.get("target") else "") for effect in effects_of(member)
    )


def member_names(group: Sequence[Member]) -> list[str]:
    """The members' names; an effect on all targets is called so where another member has it on one: "saturation (m2)",
    "saturation (all)"."""
    on_one = {effect["effect"] for member in group for effect in effects_of(member) if effect.get("target")}
    return [
        member_name(member) + (" (all)" if _is_on_all(member) and effects_of(member)[0]["effect"] in on_one else "")
        for member in group
    ]


def _is_on_all(member: Member) -> bool:
    (first, *more) = effects_of(member)
    return not more and not first.get("target")


def group_sentence(group: Sequence[Member], document: Mapping[str, Any] | None = None) -> str:
    """ "On these runs command delay and sensor delay cannot be told apart; one of them is present (probability 0.97).";
    document: the diagnosis.json, for the probability of the group, and of the members that are clearly likelier than
    the one that stands in the explanation."""
    text = f"On these runs {listed(member_names(group))} cannot be told apart"
    likelier = [] if document is None else _likelier(group, document)
    if likelier:
        return f"{text}; {listed(likelier)} {'is' if len(likelier) == 1 else 'are'} likelier."
    likely = None if document is None else together(group, document)
    return f"{text}." if likely is None else f"{text}; one of them is present (probability {likely:.2f})."


def or_else(effect: Mapping[str, Any], document: Mapping[str, Any]) -> str:
    """What may be there in the place of an effect that stands for a group: "or torque offset of tilt or sensor bias of
    position.tilt", one that is clearly likelier as "or rather ...". Empty for an effect in no group, or where there is
    little doubt. document: the diagnosis.json, or the comparison.json."""
    if effect.get("probability") is None or float(effect["probability"]) >= DOUBTED:
        return ""
    place = (effect["effect"], effect.get("target"))
    group = next((g for g in document.get("confounded") or () if [place] in [_keys(member) for member in g]), ())
    probability = _probabilities(document)
    others = [member for member in group if _keys(member) != [place]]
    own = LIKELIER * probability.get(place, 1.0)
    likelier = {i for i, m in enumerate(others) if len(_keys(m)) == 1 and probability.get(_keys(m)[0], 0.0) > own}
    order = sorted(range(len(others)), key=lambda i: i not in likelier)
    if len(others) > LISTED:
        shown = [i for i in order if i in likelier][:1]
        words = [_placed(others[i], effect, True) for i in shown] + [f"one of {len(others) - len(shown)} other effects"]
    else:
        words = [_placed(others[i], effect, i in likelier) for i in order]
    return f"or {listed(words, 'or')}" if words else ""


def _placed(member: Member, instead_of: Mapping[str, Any], likelier: bool) -> str:
    """One member, said to act on all targets where the effect in its place is the same on one."""
    said = " together with ".join(
        name_at(e) + (" of all" if e["effect"] == instead_of["effect"] and not e.get("target") else "")
        for e in effects_of(member)
    )
    return f"rather {said}" if likelier else said


def _keys(member: Member) -> list[tuple[str, str | None]]:
    return [(effect["effect"], effect.get("target")) for effect in effects_of(member)]


def _probabilities(document: Mapping[str, Any]) -> dict[tuple[str, str | None], float]:
    return {(c["effect"], c.get("target")): float(c["probability"]) for c in document.get("candidates") or ()}


def together(group: Sequence[Member], document: Mapping[str, Any]) -> float | None:
    """The probability that one of the members is there, where that is likely; None where it is not, where no member is
    named, or where members have no probability of their own, such as pairs. That of an effect counts what includes it,
    such as Stribeck friction for Coulomb friction and all targets for one: each counts once."""
    keys = [_keys(member) for member in group]
    probability = _probabilities(document)
    named = {(e["effect"], e.get("target")) for e in document.get("explanation") or ()}
    if any(len(mine) > 1 or mine[0] not in probability for mine in keys) or not named & {mine[0] for mine in keys}:
        return None
    alone = [mine[0] for mine in keys if not any(_includes(mine[0], other[0]) for other in keys)]
    total = min(sum(probability[key] for key in alone), MOST)
    return total if total >= LIKELY else None


def _includes(one: tuple[str, str | None], other: tuple[str, str | None]) -> bool:
    """Whether an effect is another one's general case: it has it with two equal numbers, or on all targets."""
    equal = BY_NAME[one[0]].equal if one[0] in BY_NAME else None
    simple = equal is not None and (equal[0], one[1]) == other
    return simple or (one[0] == other[0] and one[1] is None and other[1] is not None)


def _likelier(group: Sequence[Member], document: Mapping[str, Any]) -> list[str]:
    """The members, with their probabilities, that have more than `LIKELIER` times that of the named member, in the
    group's order; none where the group has members whose own probability is not known, such as pairs."""
    probability = _probabilities(document)
    named = {(e["effect"], e.get("target")) for e in document.get("explanation") or ()}
    known = {}
    for member in group:
        (first, *more) = ((e["effect"], e.get("target")) for e in effects_of(member))
        if more or first not in probability:
            return []
        known[first] = (probability[first], member_name(member))
    here = [known[key] for key in known if key in named]
    if len(here) != 1:
        return []
    return [f"{said} ({own:.2f})" for own, said in known.values() if own > LIKELIER * here[0][0]]
