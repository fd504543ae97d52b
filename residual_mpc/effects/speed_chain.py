"""The way of speed commands to motors that turn as fast as they are told, wheel by wheel and, where a base controller
decides on two wheels together, pair by pair: for a whole run at once in numpy (`speed_chain`) and for one step in any
array library (`speed_chains`)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from residual_mpc.effects.chain import (
    OUTPUT,
    Chain,
    chain_of,
    filled,
    in_turn,
    leaves,
    through_commands,
    through_outputs,
    where_it_acts,
)
from residual_mpc.effects.effect import Effect, Values
from residual_mpc.effects.library import Effects, present
from residual_mpc.effects.ops import NUMPY, Array, Kinks

Signals = tuple[np.ndarray, np.ndarray]  # (B, K, nu) each: means over the steps, and what they come to at their ends


def speed_chain(effects: Effects, u: np.ndarray, on: np.ndarray | None, clock: np.ndarray, dt: float) -> np.ndarray:
    """The mean speeds (B, K, nu) over each step of motors that turn as fast as they are told, before any play, from
    commands u (B, K, nu).

    A driver's voltage, which sets gain and limit, comes before the motor's inertia: a lag acts on what these leave.
    on (B, K, nu): 0 where the actuator is off, None for always on. clock (B, K, 1): s since the run began.
    """
    return speeds_and_ends(effects, u, on, clock, dt, False)[0]


def speeds_and_ends(
    effects: Effects, u: np.ndarray, on: np.ndarray | None, clock: np.ndarray, dt: float, ends: bool = True
) -> tuple[np.ndarray, np.ndarray]:
    """What `speed_chain` gives, and the speeds at the end of each step, which a lag or a ramp changes within it;
    without `ends`, the means are returned for both."""

    def out(effect: Effect, p: Values, y: np.ndarray) -> np.ndarray:
        if effect.port == "pair":
            return through_pair(effect, p, y, dt)
        if effect.port == "command":
            return through_commands(effect, p, y, dt)
        return through_outputs(effect, p, y, clock, dt)

    def through(effect: Effect, p: Values, both: Signals) -> Signals:
        mean, end = both
        after = out(effect, p, mean)
        if not ends:
            return after, after
        if effect.at_end is not None:
            return after, _at_end(effect, p, mean, end, after, dt)
        return after, after if end is mean else out(effect, p, end)

    commands = list(present(effects, "command", "pair command"))
    both = u, u
    for effect, p in commands:
        if not effect.inertial:
            both = through(effect, p, both)
    both = _switched(both, on)
    for effect, p in present(effects, *OUTPUT, "pair"):
        both = through(effect, p, both)
    both = _switched(both, on)  # a wheel that is off is not driven by its partner
    for effect, p in commands:
        if effect.inertial:
            both = through(effect, p, both)
    return both


def _at_end(effect: Effect, p: Values, mean: np.ndarray, end: np.ndarray, after: np.ndarray, dt: float) -> np.ndarray:
    """(B, K, nu) what an effect has come to at the end of each step. mean, end: before it; after: its means."""
    at_end = effect.at_end
    assert at_end is not None

    def through(p: Values, end: np.ndarray, rows: np.ndarray) -> np.ndarray:
        return at_end({k: v[:, None, :] for k, v in p.items()}, mean[rows], end, after[rows], dt)

    return where_it_acts(effect, p, end, through)


def _switched(both: Signals, on: np.ndarray | None) -> Signals:
    mean, end = both
    if on is None:
        return both
    mean_on = mean * on
    return mean_on, mean_on if end is mean else end * on


def through_pair(effect: Effect, p: Values, y: np.ndarray, dt: float) -> np.ndarray:
    """What an effect on two wheels together makes of their speeds y (B, K, 2), left and right; p: (B, 1) each. Before
    the beginning the first speeds are held."""
    assert effect.start is not None and effect.step is not None
    if not effect.remembers:
        out, _ = effect.step(NUMPY, p, (), y[..., 0], y[..., 1], dt)
        return np.stack(out, axis=-1)
    start, step = effect.start, effect.step

    def through(p: Values, y: np.ndarray, rows: np.ndarray) -> np.ndarray:
        p = {name: value[:, 0] for name, value in p.items()}

        def both(k: int, now: np.ndarray, memory: Any) -> tuple[Array, Any]:
            out, memory = step(NUMPY, p, memory, now[:, 0], now[:, 1], dt)
            return np.stack(out, axis=-1), memory

        return in_turn(both, y, start(NUMPY, p, y[:, 0, 0], y[:, 0, 1], dt))

    return where_it_acts(effect, p, y, through)


@dataclass(frozen=True)
class PairStep:
    """An effect on two wheels together, as one step with named memory. states: the names of its memory."""

    effect: Effect
    dt: float  # s
    states: tuple[str, ...]

    def __call__(
        self, kinks: Kinks, wheels: Sequence[Array], p: Values, now: Mapping[str, Array], new: dict[str, Array]
    ) -> list[Array]:
        """The speeds of both wheels behind it. now: states by name; `new` is filled with their next values."""
        assert self.effect.start is not None and self.effect.step is not None
        ops = kinks.exact if self.effect.kink == "none" else kinks.rough(1.0)
        form = self.effect.start(NUMPY, {q.name: q.null for q in self.effect.parameters}, 0.0, 0.0, self.dt)
        memory = filled(form, iter([now[s] for s in self.states]))
        out, memory = self.effect.step(ops, p, memory, *wheels, self.dt)
        new |= dict(zip(self.states, leaves(memory), strict=True))
        return list(out)

    def resting(self, wheels: Sequence[float], p: Values) -> dict[str, float]:
        """What is remembered where the speeds of both wheels have been held for ever, by state."""
        assert self.effect.start is not None
        memory = self.effect.start(NUMPY, p, *wheels, self.dt)
        return dict(zip(self.states, map(float, leaves(memory)), strict=True))


def speed_chains(
    effects: Effects, targets: tuple[str, ...], dt: float
) -> tuple[tuple[Chain, ...], tuple[PairStep, ...]]:
    """What `speed_chain` does to a command until the play: chains of each wheel, and the effects on the pair of wheels
    that act between one chain and the next."""
    on_commands = tuple(e for e, _ in present(effects, "pair command"))
    on_outputs = tuple(e for e, _ in present(effects, "pair"))
    commands = _parted(chain_of(effects, ("command",), targets, dt, inertial=False), on_commands)
    outputs = _parted(chain_of(effects, OUTPUT, targets, dt), on_outputs)
    chains = [*commands[:-1], commands[-1].then(outputs[0]), *outputs[1:]]
    chains[-1] = chains[-1].then(chain_of(effects, ("command",), targets, dt, inertial=True))
    return tuple(chains), tuple(_pair_step(e, effects, dt) for e in (*on_commands, *on_outputs))


def _parted(chain: Chain, pairs: Sequence[Effect]) -> list[Chain]:
    """The parts of a chain before, between and behind the effects on pairs, by rank."""
    parts = []
    edges: list[Effect | None] = [None, *pairs, None]
    for before, after in pairwise(edges):
        part = [
            e
            for e in chain.effects
            if (before is None or e.rank >= before.rank) and (after is None or e.rank < after.rank)
        ]
        parts.append(replace(chain, effects=tuple(part), names={e.name: chain.names[e.name] for e in part}))
    return parts


def _pair_step(effect: Effect, effects: Effects, dt: float) -> PairStep:
    assert effect.start is not None
    memory = effect.start(NUMPY, {k: v[0] for k, v in effects[effect.name].items()}, 0.0, 0.0, dt)
    label, count = effect.label or effect.name, len(leaves(memory))
    single = not isinstance(memory, tuple | list)
    return PairStep(effect, dt, (label,) if single else tuple(f"{label}.{j + 1}" for j in range(count)))
