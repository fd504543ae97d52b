"""Results of testing a diagnosis on new runs, as frozen records."""

from dataclasses import dataclass
from typing import Literal

from residual_mpc.diagnosis.predict.effect_sets import EffectSet
from residual_mpc.models.settings import Term, Values

# agrees: the effect is needed and has the expected size; other size: it is needed with a different size; denies: the
# runs contradict it, or another effect replaces it; open: undecided
Outcome = Literal["agrees", "other size", "denies", "open"]
Interval = tuple[float, float]


@dataclass(frozen=True)
class Size:
    """One parameter of an effect, in its unit. expected: its value on these runs, with an interval that includes the
    variation between motions; found: fitted to these runs alone. The intervals are 95 %."""

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
    """changed: whether the user changed the effect by a known amount before these runs; new: whether it replaces an
    effect that the diagnosis named. difference: of scores, in favour of the model with the effect over the model
    without it; for a changed effect, of the expected over the old size; for a replaced one, of the new explanation over
    the diagnosed one."""

    term: Term
    outcome: Outcome
    changed: bool
    new: bool
    difference: float
    sizes: tuple[Size, ...]


@dataclass(frozen=True)
class ExplanationTest:
    """One explanation of the diagnosis on the new runs. terms: the effects that it adds to the diagnosed explanation
    (of that one itself: all its effects); instead_of: the effects that they replace; values: parameters of the whole
    model, as diagnosed. gap: with known changes applied and nothing refitted; refitted: with the parameters fitted to
    these runs; above: its score above the lowest, or that of the best combination with it; excluded: whether its own is
    too much; nowhere: whether each combination with it is excluded as well. parts: the alternatives that it exchanges,
    by their places among the explanations; none for the diagnosed one."""

    terms: EffectSet
    instead_of: EffectSet
    values: Values
    gap: float
    refitted: float
    above: float
    excluded: bool
    nowhere: bool
    parts: tuple[int, ...] = ()

    @property
    def combined(self) -> bool:
        """Whether it exchanges more than one ambiguous effect."""
        return len(self.parts) > 1


@dataclass(frozen=True)
class NewGap:
    """Gaps on the new runs over one horizon, unitless: of the nominal model, and of the kept explanation with known
    changes applied and nothing refitted; as_good: whether the latter is as good as the sensors can tell."""

    horizon: float
    windows: int
    nominal: float
    explained: float
    noise_floor: float
    as_good: bool


@dataclass(frozen=True)
class Confirmation:
    """explanations: the diagnosed one first, then its alternatives, then combinations of these; kept: index of the
    one that is kept, which is the diagnosed one unless it is excluded; gaps: one for each horizon, the headline's
    first; whole: whether the kept explanation, refitted, is as good as the sensors can tell over that."""

    explanations: tuple[ExplanationTest, ...]
    kept: int
    effects: tuple[EffectTest, ...]
    gaps: tuple[NewGap, ...]
    whole: bool
