"""What a diagnosis is, once made: frozen records that the document and the report are written from."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.gap import Scales
from residual_mpc.diagnosis.data.hold_out import KeptBack
from residual_mpc.diagnosis.data.where import Where
from residual_mpc.diagnosis.laws.figures import FittedLaw
from residual_mpc.diagnosis.predict.effect_sets import ConfoundedGroup, EffectSet
from residual_mpc.diagnosis.predict.group_space import Sizes
from residual_mpc.diagnosis.remainder.learning import Learned
from residual_mpc.diagnosis.remainder.records import Rest
from residual_mpc.diagnosis.results.shrink import Shrink
from residual_mpc.diagnosis.results.variation_records import Variation
from residual_mpc.diagnosis.results.verdict import Verdict
from residual_mpc.diagnosis.search.testable import NotTestable
from residual_mpc.models.settings import Term, Values


@dataclass(frozen=True)
class HorizonFigures:
    """Gaps over one horizon, unitless. held_out: whether no fit has seen these windows; channels: name -> (before,
    after, noise floor); window_gaps: quantiles of the windows' own gaps "before" and "after", and
    which window has the largest."""

    horizon: float
    nominal: float
    before: float
    after: float
    noise_floor: float
    windows: int
    held_out: bool
    channels: dict[str, tuple[float, float, float]]
    window_gaps: dict[str, dict[str, Any]]

    def document(self) -> dict[str, object]:
        """As diagnosis.json has it."""
        names = ("before", "after", "noise_floor")
        channels = {c: dict(zip(names, figures, strict=True)) for c, figures in self.channels.items()}
        return {**asdict(self), "channels": channels}


@dataclass(frozen=True)
class GapFigures:
    """Gaps on the held-out windows, unitless; channels: name -> (before, after, noise floor); horizons: the same over
    each horizon; constant_velocity: the gap of a forecast that knows no model; step_error: that of the
    model's time step, None where it has none; own_step: whether that is all that is beyond the noise; blinded: whether
    the sensors' noise alone makes a perfect model worse than that forecast; new_readings: the same without what slow
    sensors repeat, None where no sensor is slow."""

    nominal: float
    before: float
    after: float
    noise_floor: float
    horizon: float
    windows: int
    skipped: int
    still: tuple[str, ...]
    channels: dict[str, tuple[float, float, float]]
    horizons: tuple[HorizonFigures, ...]
    constant_velocity: float
    step_error: float | None
    own_step: bool
    blinded: bool
    new_readings: "GapFigures | None" = None


@dataclass(frozen=True)
class Estimate:
    """A fitted number with its 95 % interval. note: what is wrong with it, empty where nothing is."""

    name: str
    value: float
    ci95: tuple[float, float]
    unit: str
    note: str = ""


@dataclass(frozen=True)
class Cause:
    term: Term
    probability: float
    parameters: tuple[Estimate, ...]
    summary: str
    only_target: str | None = None  # what "all targets" means on a robot that has one, for the wording
    evidence: tuple[str, ...] = ()
    law: FittedLaw | None = None  # where the cause has no name
    variation: Variation | None = None  # if its size is not steady


@dataclass(frozen=True)
class Candidate:
    term: Term
    probability: float
    shrink: float


@dataclass(frozen=True)
class Moved:
    """A nominal parameter that the retuning moved once the effects were added."""

    parameter: str
    before: float
    after: float


@dataclass(frozen=True)
class Alternative:
    """Another set that explains these runs as well, or nearly: the terms in which it differs from the explanation,
    those that they replace, and all of its values. ratio: likelihood ratio by which it is worse; confounded: whether
    it stands in a group, or is a close rival."""

    terms: EffectSet
    instead_of: EffectSet
    values: Values
    ratio: float
    confounded: bool


@dataclass(frozen=True)
class RivalSet:
    """A set of effects that was compared as a whole, with the share of the likelihood that it holds."""

    effects: EffectSet
    probability: float


@dataclass(frozen=True)
class GapStep:
    """The gap on the held-out windows with these effects added, unitless."""

    effects: EffectSet
    gap: float


@dataclass(frozen=True)
class StageShare:
    """A stage's share of the squared gap; "noise" and "unexplained" are stages as well."""

    name: str
    share: float


@dataclass(frozen=True)
class Setup:
    """How the runs were driven and measured, for who plans the next ones.

    period: median s between samples; commands: lowest and highest of each actuator; sigma: of each channel, and start:
    its median first value; switches: whether a motor was ever off; dispersion: of the residuals, over white noise's.
    """

    period: float
    commands: dict[str, tuple[float, float]]
    sigma: dict[str, float]
    start: dict[str, float]
    switches: bool
    dispersion: float


@dataclass(frozen=True)
class Diagnosis:
    """The whole answer. groups_of_windows: the sizes of effects in the groups 1, 2, ... of windows (see `Block`), where
    they have another one there, or do nothing; at_the_end: the values at the end of the runs, None where they are the
    same."""

    robot: str
    verdict: Verdict
    held_out: tuple[KeptBack, ...]
    gap: GapFigures
    expected: Shrink | None
    achieved: Shrink | None
    stages: tuple[StageShare, ...]
    where: Where
    causes: tuple[Cause, ...]
    candidates: tuple[Candidate, ...]
    groups: tuple[ConfoundedGroup, ...]
    rivals: tuple[RivalSet, ...]
    alternatives: tuple[Alternative, ...]
    setup: Setup
    not_testable: tuple[NotTestable, ...]
    moved: tuple[Moved, ...]
    unexplained: float
    learned: Learned
    rest: Rest | None  # None where what is left is within the noise
    steps: tuple[GapStep, ...]
    outlier_share: float
    outlier_channels: dict[str, float]
    odd_run: dict[str, object] | None
    unlike: dict[str, object] | None
    next_experiment: dict[str, object] | None
    values: Values
    notes: tuple[str, ...]
    groups_of_windows: tuple[Sizes, ...] = ()
    at_the_end: Values | None = None

    @property
    def last_values(self) -> Values:
        """The values at the end of the runs."""
        return self.values if self.at_the_end is None else self.at_the_end


@dataclass(frozen=True)
class DiagnosisResult:
    """A diagnosis and what the report draws: errors (W, M, C) of all windows before and after, and which are judged.
    base: the values of the model before, which are those that were retuned."""

    diagnosis: Diagnosis
    data: Dataset
    scales: Scales
    before: np.ndarray
    after: np.ndarray
    held: np.ndarray
    base: Values
