"""Which values the effects and the retuned parameters have, for a batch of hypotheses at once."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from residual_mpc.effects.library import BY_NAME


class Term(NamedTuple):
    """An effect on a target; target None means the robot, or all of its targets alike. changed: it acts on the later
    one of two sets of runs alone, on top of what acts on both (see `residual_mpc.comparison`)."""

    effect: str
    target: str | None
    changed: bool = False

    def __str__(self) -> str:
        return self.effect if self.target is None else f"{self.effect} [{self.target}]"


class Knob(NamedTuple):
    """One free number: a parameter of a term, or a nominal parameter that the user would retune (effect "tune")."""

    effect: str
    target: str | None
    parameter: str
    changed: bool = False

    @property
    def term(self) -> Term:
        return Term(self.effect, self.target, self.changed)


TUNE = "tune"
Values = Mapping[Knob, float]


@dataclass(frozen=True)
class Settings:
    """The values of n rows. A row is one hypothesis on one window, or one hypothesis alone.

    effects[effect][parameter] has shape (n, number of the robot's slots for that effect); an effect that is at its
    null value in every row is absent. tuned[name] (n,) holds retuned nominal parameters, absolute. others: the values
    on the windows of groups 1, 2, ... (see `Block`); empty where they are the same on all.
    """

    rows: int
    effects: Mapping[str, Mapping[str, np.ndarray]] = field(default_factory=dict)
    tuned: Mapping[str, np.ndarray] = field(default_factory=dict)
    others: "tuple[Settings, ...]" = ()

    def take(self, index: np.ndarray) -> "Settings":
        """The rows named by index, in that order (also a boolean mask)."""
        count = int(index.sum()) if index.dtype == bool else len(index)
        effects = {e: {p: v[index] for p, v in ps.items()} for e, ps in self.effects.items()}
        others = tuple(x.take(index) for x in self.others)
        return Settings(count, effects, {k: v[index] for k, v in self.tuned.items()}, others)

    def of_group(self, group: int) -> "Settings":
        """The values on the windows of a group, 0 for those of no other, alike everywhere."""
        return self.others[group - 1] if group > 0 and self.others else replace(self, others=())

    def acting(self) -> "Settings":
        """The same without the effects that do nothing in any row; some rows may lack what others have."""
        live = {e: ps for e, ps in self.effects.items() if not is_null(e, ps).all()}
        return self if len(live) == len(self.effects) else replace(self, effects=live)

    def distinct(self) -> tuple[np.ndarray, np.ndarray]:
        """(D,) index of the first occurrence of each distinct row; (n,) the place of each row among these. Ignores
        `others`."""
        columns = [v.reshape(self.rows, -1) for ps in self.effects.values() for v in ps.values()]
        columns += [v[:, None] for v in self.tuned.values()]
        if not columns:
            return np.zeros(1, dtype=int), np.zeros(self.rows, dtype=int)
        _, first, back = np.unique(np.concatenate(columns, axis=1), axis=0, return_index=True, return_inverse=True)
        return first, back.reshape(-1)

    def without(self, effect: str) -> "Settings":
        """The same rows with one effect absent."""
        others = tuple(x.without(effect) for x in self.others)
        return Settings(self.rows, {e: p for e, p in self.effects.items() if e != effect}, self.tuned, others)


def is_null(effect: str, values: Mapping[str, np.ndarray]) -> np.ndarray:
    """(n, slots) bool: where an effect does nothing. A parameter that says only how it acts does nothing alone."""
    out: np.ndarray | None = None
    for p in BY_NAME[effect].parameters:
        if p.shape:
            continue
        same = values[p.name] == p.null
        out = same if out is None else out & same
    assert out is not None
    return out


def assemble(hypotheses: Sequence[Values], slots: Mapping[str, tuple[str, ...]]) -> Settings:
    """One row per hypothesis. slots: the robot's targets for each effect.

    A term without target fills all slots. Raises ValueError for a target that the robot lacks.
    """
    n = len(hypotheses)
    effects: dict[str, dict[str, np.ndarray]] = {}
    tuned: dict[str, np.ndarray] = {}
    for knob in dict.fromkeys(k for h in hypotheses for k in h):  # a set's order would change from process to process
        if knob.effect == TUNE:
            tuned.setdefault(knob.parameter, np.full(n, np.nan))
        elif knob.effect not in effects:
            width = max(len(slots[knob.effect]), 1)
            effects[knob.effect] = {p.name: np.full((n, width), p.null) for p in BY_NAME[knob.effect].parameters}
    for i, hypothesis in enumerate(hypotheses):
        # terms without a target first, so that one on a single target overrides them
        for knob, value in sorted(hypothesis.items(), key=lambda kv: kv[0].target is not None):
            if knob.effect == TUNE:
                tuned[knob.parameter][i] = value
            elif knob.target is None:
                effects[knob.effect][knob.parameter][i, :] = value
            else:
                effects[knob.effect][knob.parameter][i, slots[knob.effect].index(knob.target)] = value
    live = {e: ps for e, ps in effects.items() if not is_null(e, ps).all()}
    return Settings(n, live, tuned)
