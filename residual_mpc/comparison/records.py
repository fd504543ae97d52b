"""What a comparison is, once made."""

from dataclasses import dataclass, field, replace

from residual_mpc.diagnosis.predict.effect_sets import ConfoundedGroup
from residual_mpc.diagnosis.search.testable import NotTestable
from residual_mpc.models.settings import Term, Values


@dataclass(frozen=True)
class ChangedNumber:
    """A number before and after, None where the effect was not there; the change between (a ratio of gains, scales
    and radii, else a difference) with its 95 % interval. note: what is wrong with it, empty where nothing is. none: the
    change of an effect that stays as it is; None for a number that says only how the effect acts."""

    name: str
    before: float | None
    after: float | None
    change: float
    ci95: tuple[float, float]
    unit: str
    note: str = ""
    none: float | None = 0.0

    @property
    def may_be_none(self) -> bool:
        """Whether the interval contains no change at all."""
        return self.none is None or self.ci95[0] <= self.none <= self.ci95[1]


@dataclass(frozen=True)
class Change:
    """term: the effect, on its target; p: probability of such a difference within one set of runs."""

    term: Term
    probability: float
    p: float
    parameters: tuple[ChangedNumber, ...]
    summary: str
    only_target: str | None = None


@dataclass(frozen=True)
class ChangeCandidate:
    """What else was looked at: how much of the cost it would take away by itself, and its p."""

    term: Term
    probability: float
    p: float


@dataclass(frozen=True)
class VisibleChange:
    """size: of the change of a number that at least four comparisons of five would find: a difference, or by how much a
    ratio differs from 1."""

    term: Term
    name: str
    size: float
    unit: str


@dataclass(frozen=True)
class GapRise:
    """By how much the mean squared gap of a window is larger after than before, and what the changes leave of that,
    each with its standard error. What is compared after is the model fitted to both sets, without and with the changes:
    what the later motions teach about the robot is none of them. A window in which the model misses more than the whole
    motion counts as one that misses the whole: predictions that diverge would hide everything else."""

    risen: float
    left: float
    risen_error: float
    left_error: float

    @property
    def visible(self) -> bool:
        """Whether the gap is larger after by more than two standard errors."""
        return self.risen > 2.0 * self.risen_error


@dataclass(frozen=True)
class Predicted:
    """What a change predicts of windows that no fit has seen, beside the others: by how much it lowers the mean squared
    gap of a window, the standard error of that, and the share of the stretches in which it lowers it."""

    gain: float
    error: float
    better: float


@dataclass(frozen=True)
class ComparedGap:
    """Gaps, unitless, each on windows that the fit has not seen: of the model fitted to the runs before on these and on
    those after, and of the model fitted to both sets with the changes on those after; folds: of the cross-validation;
    channels: the gaps by channel; predicted: what each change predicts, on both sets."""

    nominal_before: float
    nominal_after: float
    before: float
    after: float
    after_explained: float
    rise: GapRise
    noise_floor: float
    horizon: float
    windows: tuple[int, int]
    folds: int
    channels: dict[str, dict[str, float]]
    predicted: dict[Term, Predicted]

    @property
    def of_no_change(self) -> "ComparedGap":
        """The same where no change is named."""
        channels = {c: {**figures, "after_explained": figures["after"]} for c, figures in self.channels.items()}
        return replace(self, after_explained=self.after, channels=channels)


@dataclass(frozen=True)
class Comparison:
    """The whole answer. account: the effects that act on both sets; units: independent stretches before and after;
    visible: the smallest changes that these runs would show; p_left: probability that stretches of one set differ as
    much as the two sets still do."""

    robot: str
    verdict: str
    changes: tuple[Change, ...]
    groups: tuple[ConfoundedGroup, ...]
    candidates: tuple[ChangeCandidate, ...]
    gap: ComparedGap
    unexplained: float
    not_testable: tuple[NotTestable, ...]
    account: tuple[Term, ...]
    units: tuple[int, int]
    visible: tuple[VisibleChange, ...]
    p_left: float
    values: Values
    next_experiment: dict[str, object] | None
    notes: tuple[str, ...] = field(default=())
