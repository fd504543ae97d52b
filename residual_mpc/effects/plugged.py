"""A user's own effects, found by the entry point group `residual_mpc.effects`, and where robots host them."""

from collections.abc import Iterator, Mapping
from importlib.metadata import entry_points

import numpy as np

from residual_mpc.effects.effect import STAGES, Effect, Values
from residual_mpc.effects.ops import NUMPY
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
            raise BadInput(f"the effect does not import: {error!r}", where, "mend or uninstall its package") from error
        fault = fault_of(effect)
        if fault:
            raise BadInput(fault, where, "see docs/guide/your-own-effect.md")
        if effect.name in taken or effect.name in found:
            raise BadInput(f"an effect is called {effect.name!r} already", where, "give it another name")
        found[effect.name] = effect
    return tuple(found.values())


def fault_of(effect: object) -> str:
    """Why it cannot be hosted; empty where it can."""
    if not isinstance(effect, Effect):
        return f"{type(effect).__name__} came, an Effect was wanted"
    if effect.stage not in STAGES:
        return f"no stage is called {effect.stage!r}"
    if TARGETS.get(effect.port) != effect.target:
        ports = ", ".join(f"{p} on each {t}" for p, t in TARGETS.items())
        return f"its port is {effect.port!r} on {effect.target!r}; hosted are {ports}"
    if effect.step is None or (effect.port != "friction" and effect.start is None):
        return "it has no equation"
    return "" if effect.parameters else "it has no parameter"


def hosted(effects: tuple[Effect, ...], name: str, slots: Mapping[str, tuple[str, ...]]) -> tuple[str, ...]:
    """A robot's targets for a plugged effect. slots: the ports that it hosts, with their targets' names."""
    for effect in effects:
        if effect.name == name:
            return slots.get(effect.port, ())
    return ()


def present(
    effects: tuple[Effect, ...], settings: Mapping[str, Mapping[str, np.ndarray]], port: str
) -> Iterator[tuple[Effect, Mapping[str, np.ndarray]]]:
    """Those at a port that the settings hold, with their parameters (B, slots)."""
    for effect in effects:
        if effect.port == port and effect.name in settings:
            yield effect, settings[effect.name]


def through_commands(effect: Effect, p: Values, u: np.ndarray, dt: float) -> np.ndarray:
    """What an effect at the command port makes of u (B, K, nu); before its beginning the first command is held."""
    assert effect.start is not None and effect.step is not None
    memory = effect.start(NUMPY, p, u[:, 0], dt)
    out = np.empty_like(u)
    for k in range(u.shape[1]):
        out[:, k], memory = effect.step(NUMPY, p, memory, u[:, k], dt)
    return out


def through_outputs(effect: Effect, p: Values, y: np.ndarray, clock: np.ndarray, dt: float) -> np.ndarray:
    """What an effect at the output port makes of y (B, K, nu); clock (B, K, 1) s since the run began."""
    assert effect.start is not None and effect.step is not None
    memory = effect.start(NUMPY, p, y[:, 0])
    out = np.empty_like(y)
    for k in range(y.shape[1]):
        out[:, k], memory = effect.step(NUMPY, p, memory, y[:, k], clock[:, k], dt)
    return out
