"""What new runs say about a diagnosis: frozen records."""

from dataclasses import dataclass
from typing import Literal

from residual_mpc.diagnosis.predict.effect_sets import EffectSet
from residual_mpc.models.settings import Term, Values

# agrees: the effect is needed, and has its size; other size: it is needed with another one; denies: the runs show that
# it is not there, or something else takes its place; open: they do not settle it
Outcome = Literal["agrees", "other size", "denies", "open"]
Interval = tuple[float, float]


@dataclass(frozen=True)
class Size:
    """One number of an effect, in its unit. expected: in these runs, with what may differ from motion to motion in its
    interval; found: from these runs alone. The intervals are of 95 %."""

    name: str
    unit: str
    expected: float
    expected_ci95: Interval
    found: float
    found_ci95: Interval

    @property
    def agrees(self) -> bool:
        """Whether the intervals overlap."""
        return self.expected_ci95[0] <= self.found_ci95[1] and self.found_ci95[0] <= self.expected_ci95[1]


@dataclass(frozen=True)
class EffectTest:
    """changed: whether the user changed the effect by a known amount before these runs. ratio: likelihood ratio by
    which these runs prefer the model with the effect to one without it; of a changed one, to the effect as it was.
    new: whether it takes the place of an effect that the diagnosis named."""

    term: Term
    outcome: Outcome
    changed: bool
    new: bool
    ratio: float
    sizes: tuple[Size, ...]


@dataclass(frozen=True)
class ExplanationTest:
    """One explanation of the diagnosis on the new runs. terms: what it has and the diagnosis' own lacks (of the own
    one: all); instead_of: what they replace; values: of the whole model, as diagnosed. gap: as diagnosed; refitted:
    with its numbers fitted to these runs; ratio: likelihood ratio by which it is worse than the best."""

    terms: EffectSet
    instead_of: EffectSet
    values: Values
    gap: float
    refitted: float
    ratio: float
    excluded: bool


@dataclass(frozen=True)
class NewGap:
    """Gaps on the new runs over one horizon, unitless: of the nominal model, and of the best explanation as diagnosed
    and changed; as_told: whether that is as good as the sensors can tell."""

    horizon: float
    windows: int
    nominal: float
    explained: float
    noise_floor: float
    as_told: bool


@dataclass(frozen=True)
class Confirmation:
    """explanations: the diagnosis' own first, then its alternatives; best: the place of the one that agrees best with
    these runs; gaps: over each horizon, the headline's first."""

    explanations: tuple[ExplanationTest, ...]
    best: int
    effects: tuple[EffectTest, ...]
    gaps: tuple[NewGap, ...]
