"""The way of a command to the actuator and of the actuator's output to the joint: effect after effect, for a whole run
at once in numpy (`command_chain`) and for one step in any array library (`Chain`); of speeds see `speed_chain.py`."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from residual_mpc.effects.effect import Effect, Site, Values, no_memory
from residual_mpc.effects.library import CHAINED, Effects, present
from residual_mpc.effects.ops import NUMPY, Array, Kinks, Ops

OUTPUT: tuple[Site, ...] = ("strength", "limit", "output")  # what acts on an actuator's output, before the play


def command_chain(effects: Effects, u: np.ndarray, lead: int, dt: float, direct: np.ndarray) -> np.ndarray:
    """What the actuators see after the lead: (B, K, nu) from u (B, lead + K, nu).

    direct (nu,) bool: the actuators at which every effect acts on the command itself; at a position servo some act on
    its error, which only the robot knows (see `on_errors`).
    """
    acting = on_command(effects, direct)
    reach = min(sum(_reach(effect, p, lead, dt) for effect, p in acting), lead)
    u = u[:, lead - reach :]
    for effect, p in acting:
        u = through_commands(effect, p, u, dt)
    return u[:, reach:]


def _reach(effect: Effect, p: Values, lead: int, dt: float) -> int:
    """How many steps back an effect at the command port remembers its command; all of the lead where that has no end,
    as in a low-pass."""
    if effect.start is no_memory:
        return 0
    if effect.start is None or effect.trim is None:
        return lead
    return 1 + len(effect.trim((None,) * lead, p, dt))


def on_command(effects: Effects, direct: np.ndarray) -> list[tuple[Effect, Values]]:
    """The effects that act on commands, those that act on a servo's error doing nothing but where `direct` (nu,)."""
    found = []
    for effect, p in present(effects, "command"):
        if not effect.on_error:
            found.append((effect, p))
        elif direct.any():
            found.append((effect, _where(effect, p, direct)))
    return found


def on_errors(effects: Effects, servo: np.ndarray) -> list[tuple[Effect, Values]]:
    """The effects that act on the errors of position servos, doing nothing at other actuators. servo: (nu,) bool."""
    if not servo.any():
        return []
    return [(e, _where(e, p, servo)) for e, p in present(effects, "command") if e.on_error]


def through_commands(effect: Effect, p: Values, u: np.ndarray, dt: float) -> np.ndarray:
    """What an effect at the command port makes of u (B, K, nu); before its beginning the first command is held."""

    def through(p: Values, u: np.ndarray, rows: np.ndarray) -> np.ndarray:
        if effect.sequence is not None:
            return np.asarray(effect.sequence(p, u, dt))
        assert effect.start is not None and effect.step is not None
        step, memory = effect.step, effect.start(NUMPY, p, u[:, 0], dt)
        return in_turn(lambda k, now, memory: step(NUMPY, p, memory, now, dt), u, memory)

    return where_it_acts(effect, p, u, through)


def through_outputs(effect: Effect, p: Values, y: np.ndarray, clock: np.ndarray, dt: float) -> np.ndarray:
    """What an effect at the output port makes of y (B, K, nu); clock (B, K, 1) s since the run began."""

    def through(p: Values, y: np.ndarray, rows: np.ndarray) -> np.ndarray:
        assert effect.start is not None and effect.step is not None
        time = clock[rows]
        if not effect.remembers:
            out, _ = effect.step(NUMPY, {k: v[:, None, :] for k, v in p.items()}, (), y, time, dt)
            return np.asarray(out)
        step, memory = effect.step, effect.start(NUMPY, p, y[:, 0])
        return in_turn(lambda k, now, memory: step(NUMPY, p, memory, now, time[:, k], dt), y, memory)

    return where_it_acts(effect, p, y, through)


def where_it_acts(
    effect: Effect, p: Values, u: np.ndarray, through: Callable[[Values, np.ndarray, np.ndarray], np.ndarray]
) -> np.ndarray:
    """What an effect makes of u (B, K, n), by way of `through` (parameters, signal and numbers of some rows): rows
    whose parameters are null are skipped if they are at least half of all: their output is their input."""
    acts = np.zeros(len(u), dtype=bool)
    for q in effect.parameters:
        acts |= (not q.shape) & (p[q.name] != q.null).any(axis=1)
    rows = np.flatnonzero(acts)
    if 2 * len(rows) > len(u):
        return through(p, u, np.arange(len(u)))
    if not len(rows):
        return u
    out = u.copy()
    out[rows] = through({k: v[rows] for k, v in p.items()}, u[rows], rows)
    return out


def in_turn(step: Callable[[int, np.ndarray, Any], tuple[Array, Any]], u: np.ndarray, memory: Any) -> np.ndarray:
    """(B, K, n): u stepped through `step` (number of the step, signal (B, n), memory), time first in memory."""
    signal = np.ascontiguousarray(u.transpose(1, 0, 2))
    out = np.empty_like(signal)
    for k, now in enumerate(signal):
        out[k], memory = step(k, now, memory)
    return np.ascontiguousarray(out.transpose(1, 0, 2))


def scaled(ops: Ops, effects: Sequence[tuple[Effect, Values]], factor: Array, clock: Array, dt: float) -> Array:
    """A factor on the outputs after the effects at the strength site. clock: s since the run began."""
    for effect, p in effects:
        assert effect.step is not None
        factor, _ = effect.step(ops, p, (), factor, clock, dt)
    return factor


def limits_of(effects: Effects) -> tuple[np.ndarray, np.ndarray] | None:
    """(B, nu) lowest and highest output that the effects let through; None where none limits it."""
    low: Array = -np.inf
    high: Array = np.inf
    found = list(present(effects, "limit"))
    for effect, p in found:
        assert effect.step is not None
        low, high = (effect.step(NUMPY, p, (), y, 0.0, 0.0)[0] for y in (low, high))
    return (low, high) if found else None


@dataclass(frozen=True)
class Chain:
    """The effects at some sites on each actuator, as one step with named memory.

    effects: in their order. names: by effect the names of its memory, for one target ("sent.{}.1").
    """

    effects: tuple[Effect, ...]
    targets: tuple[str, ...]
    dt: float  # s
    names: Mapping[str, tuple[str, ...]]

    @property
    def states(self) -> tuple[str, ...]:
        """Names of all that is remembered, effect by effect."""
        return tuple(n.format(t) for e in self.effects for t in self.targets for n in self.names[e.name])

    @property
    def timed(self) -> bool:
        """Whether an equation reads the clock."""
        return any(e.port == "output" and e.timed for e in self.effects)

    def __call__(
        self, kinks: Kinks, target: str, signal: Array, values: Callable[[str, str], Values], now: Mapping[str, Array],
        new: dict[str, Array], clock: Array = 0.0,
    ) -> Array:  # fmt: skip
        """The signal of one target after the chain. values(effect, target): its parameters; now: states by name, `new`
        is filled with their next values."""
        for effect in self.effects:
            signal = self._through(effect, kinks, target, signal, values(effect.name, target), now, new, clock)
        return signal

    def _through(
        self, effect: Effect, kinks: Kinks, target: str, signal: Array, p: Values, now: Mapping[str, Array],
        new: dict[str, Array], clock: Array,
    ) -> Array:  # fmt: skip
        if effect.rounded is not None and kinks.width > 0:
            return effect.rounded(kinks.exact, p, signal, kinks.width)
        names = [n.format(target) for n in self.names[effect.name]]
        ops = {"none": kinks.exact, "signal": kinks.rough(1.0), "step": kinks.rough(self.dt)}[effect.kink]
        out, memory = _stepped(effect, ops, p, [now[n] for n in names], signal, clock, self.dt)
        new |= dict(zip(names, leaves(memory), strict=True))
        return out

    def then(self, after: "Chain") -> "Chain":
        """This chain and behind it another of the same targets and step."""
        return replace(self, effects=(*self.effects, *after.effects), names={**self.names, **after.names})

    def resting(self, signals: Mapping[str, float], values: Callable[[str, str], Values]) -> dict[str, float]:
        """What is remembered by a robot whose signals (by target) have been held for ever, by state."""
        out: dict[str, float] = {}
        for target in self.targets:
            signal: Array = signals[target]
            for effect in self.effects:
                p = values(effect.name, target)
                numbers = leaves(_begun(effect, p, signal, self.dt))
                names = [n.format(target) for n in self.names[effect.name]]
                out |= dict(zip(names, map(float, numbers[: len(names)]), strict=True))
                signal, _ = _stepped(effect, NUMPY, p, numbers[: len(names)], signal, 0.0, self.dt)
        return out


def chain_of(
    effects: Effects, sites: Sequence[Site], targets: tuple[str, ...], dt: float, on_error: bool | None = None,
    inertial: bool | None = None,
) -> Chain:  # fmt: skip
    """The chain of the effects (one row of settings) at these sites. on_error: only those that act on a servo's error
    (True) or on the command (False), None for all; inertial likewise."""
    here = [e for e in CHAINED if e.place in sites and e.name in effects]
    here = [e for e in here if on_error in (None, e.on_error) and inertial in (None, e.inertial)]
    names = {}
    for effect in here:
        p = {k: v[0] for k, v in effects[effect.name].items()}
        memory = _begun(effect, p, 0.0, dt)
        if effect.trim is not None:
            memory = effect.trim(memory, p, dt)
        label, count = effect.label or effect.name, len(leaves(memory))
        single = not isinstance(memory, tuple | list)
        names[effect.name] = (f"{label}.{{}}",) if single else tuple(f"{label}.{{}}.{j + 1}" for j in range(count))
    return Chain(tuple(here), targets, dt, names)


def leaves(memory: Any) -> list[Any]:
    """The numbers of a memory, which may be nested in tuples."""
    return [x for part in memory for x in leaves(part)] if isinstance(memory, tuple | list) else [memory]


def filled(form: Any, numbers: Iterator[Any]) -> Any:
    """A memory of this form that holds these numbers: the inverse of `leaves`."""
    return tuple(filled(part, numbers) for part in form) if isinstance(form, tuple | list) else next(numbers)


def joined(choose: Callable[..., Any], *memories: Any) -> Any:
    """A memory whose numbers are chosen from those of several of the same form."""
    if isinstance(memories[0], tuple | list):
        return tuple(joined(choose, *parts) for parts in zip(*memories, strict=True))
    return choose(*memories)


def _stepped(
    effect: Effect, ops: Ops, p: Values, numbers: list[Any], signal: Array, clock: Array, dt: float
) -> tuple[Array, Any]:
    """The signal after one step of the effect, and its memory, which held these numbers before."""
    assert effect.step is not None
    time = (clock,) if effect.port == "output" else ()
    out, memory = effect.step(ops, p, _packed(effect, p, numbers, dt), signal, *time, dt)
    return out, memory


def _begun(effect: Effect, p: Values, signal: Any, dt: float) -> Any:
    """The memory at its beginning."""
    if effect.start is None:
        return ()
    return effect.start(NUMPY, p, signal, dt) if effect.port == "command" else effect.start(NUMPY, p, signal)


def _packed(effect: Effect, p: Values, numbers: list[Any], dt: float) -> Any:
    """A memory of the effect's own form that holds these numbers."""
    if effect.trim is not None:  # a line of any length
        return tuple(numbers)
    form = _begun(effect, {q.name: q.null for q in effect.parameters}, 0.0, dt)
    return filled(form, iter(numbers))


def _where(effect: Effect, p: Values, chosen: np.ndarray) -> Values:
    """The parameters (B, nu) at the chosen actuators (nu,), their null values at the others."""
    return {q.name: np.where(chosen, p[q.name], q.null) for q in effect.parameters}
