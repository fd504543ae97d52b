"""A user's own effects, found by the entry point group `residual_mpc.effects`."""

from dataclasses import replace
from importlib.metadata import entry_points

from residual_mpc.effects.effect import STAGES, Effect
from residual_mpc.errors import BadInput

GROUP = "residual_mpc.effects"
TARGETS = {"command": "actuator", "output": "actuator", "friction": "joint"}  # by the port that the equation takes


def plugged_in(taken: frozenset[str]) -> tuple[Effect, ...]:
    """The effects that installed packages offer, by name. taken: names that the library has.

    Raises BadInput for what does not load, is no Effect, or cannot be hosted.
    """
    found: dict[str, Effect] = {}
    for entry in sorted(entry_points(group=GROUP), key=lambda e: e.name):
        where = f"entry point {entry.name} = {entry.value}"
        try:
            effect = entry.load()
        except Exception as error:  # importing a user's module runs their code
            fault = f"the effect cannot be imported: {error!r}"
            raise BadInput(fault, where, "fix or uninstall its package") from error
        fault = fault_of(effect)
        if fault:
            raise BadInput(fault, where, "see docs/guide/your-own-effect.md")
        if effect.name in taken or effect.name in found:
            raise BadInput(f"an effect named {effect.name!r} exists already", where, "give it another name")
        found[effect.name] = replace(effect, own=True)
    return tuple(found.values())


def fault_of(effect: object) -> str:
    """Why it cannot be hosted; empty where it can."""
    if not isinstance(effect, Effect):
        return f"must be an Effect, got {type(effect).__name__}"
    if effect.stage not in STAGES:
        return f"unknown stage {effect.stage!r}"
    if TARGETS.get(effect.port) != effect.target:
        ports = " or ".join(f"{p!r} on {t!r}" for p, t in TARGETS.items())
        return f"its port must be {ports}, got {effect.port!r} on {effect.target!r}"
    if effect.step is None or (effect.port != "friction" and effect.start is None):
        return "it has no equation"
    if effect.rounded is not None and effect.remembers:
        return (
            "it has a `rounded` equation, which takes no memory, and a `start` that gives one: leave `rounded` out, "
            "or use `no_memory` as `start`"
        )
    return "" if effect.parameters else "it has no parameter"
