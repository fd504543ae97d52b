"""What a twin has and its model lacks, in the library's words: for scoring and for the oracle alone."""

from __future__ import annotations

from typing import Any

from residual_mpc.effects.effect import Effect

Named = dict[tuple[str, str | None, str], float]  # (effect, target, parameter) -> true value


def named(*sizes: tuple[Effect, float]) -> Named:
    """Effects of one parameter that is not optional, at all their targets alike, those left out that do nothing."""
    out: Named = {}
    for effect, size in sizes:
        (parameter,) = (p for p in effect.parameters if not p.optional)
        if size != parameter.null:
            out[effect.name, None, parameter.name] = size
    return out


def records(effects: Named) -> list[dict[str, Any]]:
    """The same as a file of the truth holds them."""
    return [{"effect": e, "target": target, "parameters": {p: value}} for (e, target, p), value in effects.items()]
