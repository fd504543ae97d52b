"""What tunes probabilities, intervals and support of the answer; with all that the packages below need."""

from dataclasses import dataclass, field

from residual_mpc.diagnosis.checks import check_positive, check_share
from residual_mpc.diagnosis.data.settings import DataSettings
from residual_mpc.diagnosis.fit.settings import FitSettings
from residual_mpc.diagnosis.laws.settings import LawSettings
from residual_mpc.diagnosis.predict.settings import PredictSettings
from residual_mpc.diagnosis.remainder.settings import RemainderSettings
from residual_mpc.diagnosis.search.settings import SearchSettings


@dataclass(frozen=True)
class CauseSettings:
    """form: of the relative size of what the named effects leave, which may lie along an effect and pull its number;
    law: the smallest half-width of a 95 % interval, relative to the size of the effect, since no robot obeys its model
    exactly; an effect that predicts no more of the motion than that, beside another, may be what the other's law lacks;
    order: the share of a lag by which the lag and a dead time named with it may be wrong, since real motors
    are of second order. most_sure: the library may lack the cause, whatever the likelihoods say; most_partial: factor
    where something is left that these sensors can tell; nothing: share of what they can tell, up to which a remainder
    counts as nothing; shadow: of the probability that is lost for each factor e by
    which more is left than they can tell, down to the factor least_sure; standing_low, standing_high: of
    `Support.standing`, between which what is left lowers the probability by ever less; useful: the share of a
    constant-velocity forecast's squared gap below which the probability falls in proportion to what the explained model
    removes of it, down to that factor. coarse: the most where the model's time step may be the cause. resting: factor
    on an effect with a number that rests on the bound of what is tried, or that may do nothing by its intervals, or
    that is one of two which one effect could replace that these runs cannot show;
    beside: share of the way from doing nothing to a bound within which a number rests on it where its interval ends
    there. doubtful: factor on an effect's probability below which the other numbers' intervals do without it too;
    minor: share of what another effect predicts of the motion, below which `resting` counts for that. apart:
    half-widths beyond which an interval is that wide since two fits end apart. fewest_runs: from which their
    disagreement widens intervals; agree: how often runs that agree do so too; contributing: share of the runs that a
    number has to depend on for that. unlikely: probability before it is shared among rivals, below which an effect is
    left out if the squared gap then rises by at most the share `little` of its initial excess over the floor, and the
    gap to at most `rises` times what it was; telling: members of the largest group that still tells what is there."""

    form: float = 0.5
    law: float = 0.03
    order: float = 0.12
    most_sure: float = 0.97
    most_partial: float = 0.87
    nothing: float = 0.8
    shadow: float = 0.15
    least_sure: float = 0.5
    standing_low: float = 10.0
    standing_high: float = 100.0
    useful: float = 0.5
    coarse: float = 0.5
    resting: float = 0.5
    beside: float = 0.02
    doubtful: float = 0.75
    minor: float = 0.1
    apart: float = 2.5
    fewest_runs: int = 4
    agree: float = 0.2
    contributing: float = 0.35
    unlikely: float = 0.3
    little: float = 0.01
    rises: float = 1.2
    telling: int = 3

    def __post_init__(self) -> None:
        check_share(self, "form", "law", "order", "most_sure", "most_partial", "nothing", "shadow", "least_sure",
                    "useful", "coarse", "resting", "beside", "doubtful", "minor", "agree", "contributing", "unlikely",
                    "little")  # fmt: skip
        check_positive(self, "apart", "fewest_runs", "standing_low", "telling", "rises")
        if not self.standing_high > self.standing_low:
            raise ValueError(f"CauseSettings.standing_high must be > standing_low, got {self.standing_high}")


@dataclass(frozen=True)
class GapSettings:
    """least: share of the squared gap, over one horizon, that an explanation has to remove; worse: times the gap before
    that the headline's may become where a longer horizon gains; useless: gap from which a model that is worse than a
    forecast of constant velocity by `certain` standard errors says nothing; step_part: of the squared gap beyond the
    noise, from which the error of the model's time step may be all of it; step_most: of what effects leave, from which
    that error is most of it; step_rest: share of it up to which what is left without it may be its own inaccuracy."""

    least: float = 0.02
    worse: float = 1.02
    useless: float = 0.3
    certain: float = 2.0
    step_part: float = 0.25
    step_most: float = 0.5
    step_rest: float = 0.2

    def __post_init__(self) -> None:
        check_positive(self, "worse", "useless", "certain")
        check_share(self, "least", "step_part", "step_most", "step_rest")


@dataclass(frozen=True)
class SupportSettings:
    """kept: of its distance from null that a number keeps when any run is left out. depends: share of a remainder from
    which its dependence casts doubt. clear: times the squared noise floor, from which an effect's contribution is no
    faint one; large: times what numbers are off anyway, from which an effect is no such difference. steps: simulation
    steps that one prediction may cost. unsupported: factor on the probability of an effect that does not help on unseen
    windows, rests on a single run of several, or is imitated."""

    kept: float = 0.3
    depends: float = 0.2
    clear: float = 1.0
    large: float = 3.0
    steps: int = 30_000
    unsupported: float = 0.5

    def __post_init__(self) -> None:
        check_share(self, "kept", "depends", "unsupported")
        check_positive(self, "clear", "steps")
        if not self.large > 1.0:
            raise ValueError(f"SupportSettings.large must be > 1, got {self.large}")


@dataclass(frozen=True)
class VariationSettings:
    """beyond_doubt, per_part: drop in cost over dispersion that a variation of an effect's size must be worth, and what
    each further part of the windows adds to that; material: spread of the sizes, relative to the effect, from which
    it is stated; absent: share of the size on the other side of an instant below which an effect counts as absent;
    told: standard error of the size in a part, relative to the effect, up to which the part tells of it; free: times a
    limit or a stiffness, from which on it restricts nothing; screened: share of the required drop
    that the derivatives must predict before anything is replayed; steps: maximum simulation steps of a prediction;
    runs: most runs that are compared with each other; fewest: windows on either side of an instant."""

    beyond_doubt: float = 20.0
    per_part: float = 4.0
    material: float = 0.15
    absent: float = 0.25
    told: float = 0.5
    free: float = 10.0
    screened: float = 0.4
    steps: int = 40_000
    runs: int = 24
    fewest: int = 3

    def __post_init__(self) -> None:
        check_positive(self, "beyond_doubt", "per_part", "material", "told", "free", "steps", "runs", "fewest")
        check_share(self, "absent", "screened")


@dataclass(frozen=True)
class PartSettings:
    """Effects that act in a part of the runs alone, or have their own size in each run, are looked for where one
    explanation of all runs leaves a gap of more than `over_floor` times the noise floor. A part and its rest have at
    least `fewest` windows; where no named effect begins or ends, the gap in the part is `times` that in the rest, and
    the variance between the logarithms of the two exceeds that within them by the factor `beyond_doubt`. tried: parts
    that are searched; most: effects that may be absent from the rest; as_good: times the least squared error in the
    rest, up to which fewer effects are absent. smaller: times the squared error of effects that always act alike, below
    which the others count, if the mean logarithm of the ratio is more than `told` times its standard error between the
    stretches of time in which the two differ by more than the share `alike` of what is usually left. sized: factor on
    the probability of an effect with its own size in each run: another law may make it. stretches: fewest of these;
    sizes_tried: of a held-out run, over the range of the others' sizes and the share `wider` of it on either side;
    crossing: times the usual squared error of a window, from which one next to the instant lies across it; dated:
    standard deviations of what the effects gain in so many windows by chance, by which an instant in a held-out run has
    to be better than its ends."""

    over_floor: float = 1.5
    fewest: int = 5
    times: float = 1.7
    beyond_doubt: float = 25.0
    tried: int = 2
    most: int = 6
    as_good: float = 1.1
    smaller: float = 0.6
    told: float = 3.0
    alike: float = 0.2
    sized: float = 0.85
    stretches: int = 4
    sizes_tried: int = 9
    wider: float = 0.5
    crossing: float = 4.0
    dated: float = 1.25

    def __post_init__(self) -> None:
        check_positive(self, "over_floor", "fewest", "times", "beyond_doubt", "tried", "most", "as_good", "told",
                       "stretches", "sizes_tried", "wider", "crossing", "dated")  # fmt: skip
        check_share(self, "smaller", "alike", "sized")


@dataclass(frozen=True)
class AsideSettings:
    """Stretches that are unlike everything else: of at least `fewest` windows, those whose scaled error is more than
    `unlike` times the quantile `usual` of all, more than `noise` times what a perfect model would have in the same
    window, and more than `least`; if they are at most the share `most` of the windows, in at most so many `stretches`,
    with up to `apart` others between two windows of one, and make at least the `share` of all squared errors."""

    fewest: int = 20
    usual: float = 0.75
    unlike: float = 6.0
    noise: float = 3.0
    least: float = 0.05
    most: float = 0.1
    stretches: int = 3
    apart: int = 3
    share: float = 0.6

    def __post_init__(self) -> None:
        check_positive(self, "fewest", "unlike", "noise", "least", "stretches", "apart")
        check_share(self, "usual", "most", "share")


@dataclass(frozen=True)
class ResultSettings:
    """closest: rivals outside the groups whose values are kept; bootstrap: draws of the shrink's interval;
    full_subsets: of the effects, from which on there are fewer windows for each in the stages' shares."""

    remainder: RemainderSettings = field(default_factory=RemainderSettings)
    causes: CauseSettings = field(default_factory=CauseSettings)
    gaps: GapSettings = field(default_factory=GapSettings)
    support: SupportSettings = field(default_factory=SupportSettings)
    laws: LawSettings = field(default_factory=LawSettings)
    variation: VariationSettings = field(default_factory=VariationSettings)
    parts: PartSettings = field(default_factory=PartSettings)
    aside: AsideSettings = field(default_factory=AsideSettings)
    closest: int = 3
    bootstrap: int = 2000
    full_subsets: int = 32

    def __post_init__(self) -> None:
        check_positive(self, "closest", "bootstrap", "full_subsets")

    @property
    def search(self) -> SearchSettings:
        return self.remainder.search

    @property
    def fit(self) -> FitSettings:
        return self.search.fit

    @property
    def predict(self) -> PredictSettings:
        return self.search.predict

    @property
    def data(self) -> DataSettings:
        return self.search.data
