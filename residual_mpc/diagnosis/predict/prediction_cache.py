"""Predictions that were made before: a search asks for the same hypothesis again, under other weights or on fewer
windows, and a replay costs more than all else."""

from collections import OrderedDict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.diagnosis.predict.settings import LongerStepSettings
from residual_mpc.diagnosis.predict.space import Space
from residual_mpc.diagnosis.predict.step_lengths import shorter_steps
from residual_mpc.effects.effect import Site
from residual_mpc.effects.library import BY_NAME
from residual_mpc.models.settings import TUNE, Knob, Term, Values

ROOM = 16_000_000  # numbers that are kept
APART: tuple[Site, ...] = ("play", "spring")  # between a motor and its link

Key = frozenset[tuple[Knob, float]]


@dataclass(frozen=True, eq=False)
class Carried:
    """Columns (W, M * C, K) of the small differences about these values, in the order of the candidates."""

    values: Values
    candidates: tuple[Term, ...]
    columns: np.ndarray

    def near(self, space: Space, values: Values, steps: float) -> bool:
        """Whether they hold for other values of the same numbers: all within so many typical steps."""
        if space.candidates != self.candidates or set(values) != set(self.values):
            return False
        return all(abs(v - self.values[k]) <= steps * space.scale(k) for k, v in values.items())


@dataclass(frozen=True, eq=False)
class PredictionCache:
    """The predictions of hypotheses on the windows of `data`, the latest of them kept.

    source: where the same hypotheses may be known from; its windows `pick` (W_source,), cut to what `data` holds of
    each, are these. own: the same windows with the steps of the user's model, where those of `data` are longer; change
    (W, M, C): what these would change, as measured at one hypothesis and added to every prediction (see `about`).
    """

    data: Dataset
    space: Space
    source: "PredictionCache | None" = None
    pick: np.ndarray | None = None
    own: Dataset | None = None
    change: np.ndarray | None = None
    kept: "OrderedDict[Key, np.ndarray]" = field(default_factory=OrderedDict)
    carried: "list[Carried]" = field(default_factory=list)  # the latest alone
    shorter: "dict[int, PredictionCache]" = field(default_factory=dict)  # caches on shorter steps, by step multiple

    def __getstate__(self) -> dict[str, Any]:
        """Without what the search held on other steps."""
        return {**self.__dict__, "shorter": {}}

    def __call__(self, hypotheses: Sequence[Values]) -> np.ndarray:
        """(H, W, M, C) channel units; see `predict`."""
        found = self._on_these_steps(hypotheses)
        if self.change is None:
            return found
        longer = np.array([not keeps_steps(h) for h in hypotheses])
        return found + np.where(longer[:, None, None, None], self.change, 0.0)

    def about(self, values: Values, size: np.ndarray, tuned: LongerStepSettings) -> "PredictionCache":
        """The same with the predictions of the user's model at these values, and of near ones but for what longer steps
        change of the difference. Longer steps are given up where they change too much of the motion, size (C,), or of
        what these values leave, for shorter ones and in the end for the model's own: the search is then for something
        smaller than they can be trusted with. So they are where these values keep the model's own steps: what longer
        ones change for the others is then not known."""
        if self.own is None:
            return self
        if keeps_steps(values):
            return self._alone(self._with_steps_of(self.own))
        exact = self._with_steps_of(self.own)._on_these_steps([values])[0]
        seen = np.isfinite(self.data.y) & np.isfinite(size)
        left = _mean_squares(self.data.y - exact, size, seen)
        for data in shorter_steps(self.data, self.own):
            here = self if data is self.data else self._with_steps_of(data)
            change = exact - here._on_these_steps([values])[0]
            changed = _mean_squares(change, size, seen)
            if changed.max() <= tuned.error**2 and (changed <= tuned.of_left**2 * left).all():  # nan is not
                return replace(self._alone(here), change=np.where(np.isfinite(self.data.y), change, 0.0))
        return self._alone(self._with_steps_of(self.own))

    def _with_steps_of(self, data: Dataset) -> "PredictionCache":
        """On the shorter steps of `data`, the same windows, with what was predicted on these before."""
        times = max(b.own for b in data.blocks)
        if times not in self.shorter:
            own = None if data is self.own else self.own
            self.shorter[times] = PredictionCache(data, self.space, own=own)
        return self.shorter[times]

    def _alone(self, here: "PredictionCache") -> "PredictionCache":
        """Returns `here`, and frees the predictions of the other step lengths."""
        for other in self.shorter.values():
            if other is not here:
                other.kept.clear()
                other.carried.clear()
        return here

    def _on_these_steps(self, hypotheses: Sequence[Values]) -> np.ndarray:
        """(H, W, M, C) as the steps of `data` have it."""
        keys = [_key(h) for h in hypotheses]
        found = {key: known for key in keys if (known := self.known(key)) is not None}
        new: Mapping[Key, Values] = {k: h for k, h in zip(keys, hypotheses, strict=True) if k not in found}
        if new:
            fresh = predict(self.data, self.space.settings(list(new.values())))
            if len(new) == len(keys):
                self._keep(new, fresh)
                return fresh
            found |= dict(zip(new, fresh, strict=True))
            self._keep(new, fresh)
        return np.stack([found[k] for k in keys])

    def known(self, key: Key) -> np.ndarray | None:
        """(W, M, C) of a hypothesis that was replayed before; None for another."""
        mine = self.kept.get(key)
        if mine is not None:
            self.kept.move_to_end(key)
            return mine
        theirs = None if self.source is None else self.source.known(key)
        return None if theirs is None else theirs[self.pick, : self.data.y.shape[1]]

    def of(self, data: Dataset, pick: np.ndarray) -> "PredictionCache":
        """On some of these windows, whole or cut short."""
        change = None if self.change is None else self.change[pick, : data.y.shape[1]]
        return PredictionCache(data, self.space, self, pick, change=change)

    def _keep(self, new: Mapping[Key, Values], fresh: np.ndarray) -> None:
        most = max(1, ROOM // self.data.y.size)
        for key, one in list(zip(new, fresh, strict=True))[-most:]:
            self.kept[key] = one.copy()  # a view would hold the whole batch
        while len(self.kept) > most:
            self.kept.popitem(last=False)


def keeps_steps(values: Values) -> bool:
    """Whether a robot with these values is replayed with the steps of the user's model, however long those of the
    windows are: motors that are told apart from their links are too stiff for longer ones."""
    return any(
        k.effect != TUNE and BY_NAME[k.effect].place in APART and v != BY_NAME[k.effect].parameter(k.parameter).null
        for k, v in values.items()
    )


def _mean_squares(error: np.ndarray, size: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """(C,) mean square of an error (W, M, C) relative to the motion, size (C,), where `seen`; 0 for a channel that is
    nowhere seen, nan or infinity where a prediction is none."""
    with np.errstate(invalid="ignore", over="ignore"):
        square = np.where(seen, (error / size) ** 2, 0.0)
    return np.asarray(square.sum(axis=(0, 1)) / np.maximum(seen.sum(axis=(0, 1)), 1))


def _key(values: Values) -> Key:
    """The same numbers by another route differ in their last digits."""
    return frozenset((knob, float(f"{value:.12g}")) for knob, value in values.items())
