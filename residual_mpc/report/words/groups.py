"""Groups of effects that cannot be told apart, in words."""

from collections.abc import Mapping, Sequence
from typing import Any

from residual_mpc.report.words.effects import name
from residual_mpc.report.words.numbers import listed

LIKELIER = 2.0  # times the probability of a group's named member, from which another is worth a word

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
    """ "On these runs command delay and sensor delay cannot be told apart."; document: the diagnosis.json, for a member
    that is clearly likelier than the one that stands in the explanation."""
    text = f"On these runs {listed(member_names(group))} cannot be told apart"
    likelier = None if document is None else _likelier(group, document)
    return f"{text}." if likelier is None else f"{text}; {likelier} is likelier."


def _likelier(group: Sequence[Member], document: Mapping[str, Any]) -> str | None:
    """The likeliest member and its probability, where that is `LIKELIER` times that of the named member; None where it
    is not, or the group has members whose own probability is not known, such as pairs."""
    probability = {(c["effect"], c.get("target")): float(c["probability"]) for c in document.get("candidates") or ()}
    named = {(e["effect"], e.get("target")) for e in document.get("explanation") or ()}
    known = {}
    for member in group:
        (first, *more) = ((e["effect"], e.get("target")) for e in effects_of(member))
        if more or first not in probability:
            return None
        known[first] = (probability[first], member_name(member))
    here = [known[key] for key in known if key in named]
    if len(here) != 1:
        return None
    best, name_of_best = max(known.values())
    return f"{name_of_best} ({best:.2f})" if best > LIKELIER * here[0][0] else None
