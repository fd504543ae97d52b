"""Which effects may be withheld from the library of a sealed case."""

from __future__ import annotations

from collections.abc import Collection

from residual_mpc.effects.equivalents import UNMEASURED, has_substitute, inseparable_from


def may_be_withheld(effect: str, traits: Collection[str]) -> bool:
    """Whether a library without ``effect`` has nothing that does nearly the same on runs with ``traits``."""
    if "arm" in traits and effect in UNMEASURED:
        return False
    return not inseparable_from(effect, traits) and not has_substitute(effect)
