"""Groups of effects that cannot be told apart, in words."""

from collections.abc import Mapping, Sequence
from typing import Any

from residual_mpc.report.words.effects import name
from residual_mpc.report.words.numbers import listed

Member = Mapping[str, Any] | Sequence[Mapping[str, Any]]  # several act together


def effects_of(member: Member) -> list[Mapping[str, Any]]:
    """A member as the list of its effects."""
    return [member] if isinstance(member, Mapping) else list(member)


def member_name(member: Member) -> str:
    """ "backlash (elbow) together with Stribeck friction (elbow)"."""
    return " together with ".join(
        name(effect) + (f" ({effect['target']})" if effect.get("target") else "") for effect in effects_of(member)
    )


def group_sentence(group: Sequence[Member]) -> str:
    """ "On these runs command delay and sensor delay cannot be told apart."."""
    return f"On these runs {listed([member_name(member) for member in group])} cannot be told apart."
