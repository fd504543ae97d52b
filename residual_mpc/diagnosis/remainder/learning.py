"""What a learner removes of the gap that the named effects leave: learned, chosen, judged on windows of their own."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.gap import Scales, gap_of, per_window
from residual_mpc.diagnosis.data.hold_out import choose_held_out, held_out_mask
from residual_mpc.diagnosis.fit.cross_validation import folds_of
from residual_mpc.diagnosis.fit.ridge import fit_ridge, subtract_ridge
from residual_mpc.diagnosis.fit.settings import FitSettings
from residual_mpc.diagnosis.remainder.settings import RemainderSettings
from residual_mpc.models.settings import Settings


@dataclass(frozen=True, eq=False)
class Remainder:
    """What the explanation leaves. settings: one row, the explanation's values; predicted, error (W, M, C): its
    prediction and measured - predicted, channel units. Of the windows (W,) bool, `learn` may be learned from, `choose`
    decides what is learned well (none where the runs are too short for that), and `judge` is what no fit has seen."""

    data: Dataset
    scales: Scales
    settings: Settings
    predicted: np.ndarray
    error: np.ndarray
    learn: np.ndarray
    choose: np.ndarray
    judge: np.ndarray


class Learner(Protocol):
    """One way to learn what no effect explains."""

    @property
    def name(self) -> str: ...

    def left(self, of: Remainder, rng: np.random.Generator) -> np.ndarray | None:
        """(W, M, C) the error that is left on the windows `choose` and `judge`; None where there is too little to learn
        from."""
        ...


@dataclass(frozen=True)
class Learned:
    """shrink: 1 - after / before of the remainder's gap on the windows kept back, 0 where nothing helped. by: the
    learner that was chosen, None where nobody was. asked: those that were tried."""

    shrink: float = 0.0
    by: str | None = None
    asked: tuple[str, ...] = ()


NOTHING = Learned()  # nobody was asked
ROUNDING = 1e-9  # of the gap: a learner that removes no more has left the error as it was, but for its rounding


def remainder_of(
    data: Dataset,
    scales: Scales,
    settings: Settings,
    predicted: np.ndarray,
    error: np.ndarray,
    judge: np.ndarray,
    tuning: RemainderSettings,
) -> Remainder:
    """The windows that are not kept back to `judge` (W,) parted into those that are learned from and those that choose,
    as a diagnosis parts its own."""
    seen = data.take(~judge)
    kept = choose_held_out(seen, per_window(seen, scales, error[~judge]), settings=tuning.data)
    choose = held_out_mask(data, kept) & ~judge if kept else np.zeros_like(judge)
    return Remainder(data, scales, settings, predicted, error, ~judge & ~choose, choose, judge)


def learn(of: Remainder, learners: Sequence[Learner], rng: np.random.Generator) -> Learned:
    """What the learner that does best on the windows `choose` removes on those kept back; to learn nothing is one of
    the choices."""
    if not of.judge.any() or not of.choose.any():
        return NOTHING
    asked = of.choose | of.judge
    measured = np.isfinite(of.error[asked])
    left: dict[str | None, np.ndarray] = {None: of.error}
    tried = []
    for learner in learners:
        found = learner.left(of, rng)
        if found is not None:
            tried.append(learner.name)
            if np.isfinite(found[asked][measured]).all():  # it did not run away
                left[learner.name] = found
    chooses = {name: gap_of(of.data, of.scales, e, of.choose).total for name, e in left.items()}
    best = min(chooses, key=lambda name: chooses[name])
    by = best if chooses[best] < (1.0 - ROUNDING) * chooses[None] else None
    before, after = (gap_of(of.data, of.scales, left[name], of.judge).total for name in (None, by))
    return Learned(max(1.0 - after / before, 0.0) if before > 0.0 else 0.0, by, tuple(tried))


@dataclass(frozen=True)
class RidgeLearner:
    """Learns from all the windows that it is given."""

    name: str = "ridge"
    settings: FitSettings = field(default_factory=FitSettings)

    def left(self, of: Remainder, rng: np.random.Generator) -> np.ndarray:
        """As `residual_mpc.diagnosis.remainder.learning.Learner`."""
        rows, asked = of.data.take(of.learn), of.choose | of.judge
        fitted = fit_ridge(
            rows,
            of.scales,
            of.error[of.learn],
            of.predicted[of.learn],
            folds_of(rows, settings=self.settings),
            settings=self.settings,
        )
        left = np.full(of.error.shape, np.nan)
        left[asked] = subtract_ridge(
            fitted, of.data.take(asked), of.scales, of.error[asked], of.predicted[asked], settings=self.settings
        )
        return left
