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


def group_sentence(group: Sequence[Member], candidates: Sequence[Mapping[str, Any]] = ()) -> str:
    """ "On these runs command delay and sensor delay cannot be told apart."; candidates: those of diagnosis.json, for
    the member that is clearly likelier than the one that stands in the explanation."""
    text = f"On these runs {listed([member_name(member) for member in group])} cannot be told apart"
    probability = {(c["effect"], c.get("target")): float(c["probability"]) for c in candidates}
    known = [
        (probability.get((e["effect"], e.get("target")), 0.0), member_name(m))
        for m in group
        for e in effects_of(m)
        if len(effects_of(m)) == 1
    ]
    if len(known) > 1:
        (named, _), (best, likelier) = known[0], max(known)
        if best > LIKELIER * named:
            return f"{text}; {likelier} is likelier ({best:.2f})."
    return f"{text}."
