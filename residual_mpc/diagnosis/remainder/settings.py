"""What tunes the description of what no named effect explains."""

from dataclasses import dataclass, field

from residual_mpc.diagnosis.checks import check_positive, check_share
from residual_mpc.diagnosis.data.settings import DataSettings
from residual_mpc.diagnosis.fit.settings import FitSettings
from residual_mpc.diagnosis.predict.settings import PredictSettings
from residual_mpc.diagnosis.search.settings import SearchSettings


@dataclass(frozen=True)
class BasesSettings:
    """knots: of a function of a coordinate. teeth: repetitions a turn that a joint's angle is searched for. stretch: of
    a wheel's angle, since what is commanded is not quite what is turned. phased_runs: runs up to which each has a phase
    of its own; windows_per_run: windows of a run, on average, before it is given a number of its own."""

    knots: int = 6
    teeth: tuple[int, ...] = tuple(range(2, 61))
    stretch: tuple[float, ...] = (0.94, 0.96, 0.98, 1.0, 1.02, 1.04, 1.06)
    phased_runs: int = 12
    windows_per_run: int = 4

    def __post_init__(self) -> None:
        check_positive(self, "knots", "phased_runs", "windows_per_run")


@dataclass(frozen=True)
class CoordinateSettings:
    """rate_over: s over which a command's rate is taken; clear: of a joint's usual speed, from which its direction of
    motion is clear."""

    rate_over: float = 0.05
    clear: float = 0.05

    def __post_init__(self) -> None:
        check_positive(self, "rate_over", "clear")


@dataclass(frozen=True)
class MissingRateSettings:
    """instants: of a window at which its error is looked at. A window counts in full up to `large` times the quantile
    `usual` of the windows' errors. kick: of a channel's size (per second), by which the start's rate is moved to see
    the response."""

    instants: int = 8
    usual: float = 0.8
    large: float = 2.0
    kick: float = 1e-3

    def __post_init__(self) -> None:
        check_positive(self, "instants", "large", "kick")
        check_share(self, "usual")


@dataclass(frozen=True)
class DependenceSettings:
    """draws: permutations of the windows' remainders (beyond all of 39 is beyond chance at one in forty). folds: of the
    cross-validation; block: windows in a row that stay on one side of a fold; ridge: relative."""

    draws: int = 39
    folds: int = 5
    block: int = 3
    ridge: float = 3e-3

    def __post_init__(self) -> None:
        check_positive(self, "draws", "folds", "block", "ridge")


@dataclass(frozen=True)
class DescriptionSettings:
    """windows: that are looked at: more cost more than they tell. Of the remainder: small: share below which a
    component is not looked at; worth: share below which a dependence is not named; alike: share within which the
    simpler of two coordinates is named; more: share that has to be left for a second dependence to be looked for.
    named: dependences at most. floor_draws: of the noise, which tell what of a remainder is noise."""

    windows: int = 320
    small: float = 0.05
    worth: float = 0.1
    alike: float = 0.03
    more: float = 0.25
    named: int = 2
    floor_draws: int = 4

    def __post_init__(self) -> None:
        check_positive(self, "windows", "named", "floor_draws")
        check_share(self, "small", "worth", "alike", "more")


@dataclass(frozen=True)
class ResemblanceSettings:
    """steps: simulation steps that one hypothesis may cost; fitted: candidates that are fitted, for `most` steps each:
    a fit has to rank, and to say how much it closes to a few percent; least: of the remainder, below which nothing
    resembles it."""

    steps: int = 8_000
    fitted: int = 4
    most: int = 5
    least: float = 0.02

    def __post_init__(self) -> None:
        check_positive(self, "steps", "fitted", "most")
        check_share(self, "least")


@dataclass(frozen=True)
class ShapeSettings:
    """knots: of a curve that is shown; ridge: relative."""

    knots: int = 8
    ridge: float = 1e-6

    def __post_init__(self) -> None:
        check_positive(self, "knots", "ridge")


@dataclass(frozen=True)
class RemainderSettings:
    """learned_from: gap, as a share of the motion, from which a learner is run: its minutes buy nothing below."""

    learned_from: float = 0.01
    search: SearchSettings = field(default_factory=SearchSettings)
    bases: BasesSettings = field(default_factory=BasesSettings)
    coordinates: CoordinateSettings = field(default_factory=CoordinateSettings)
    missing_rates: MissingRateSettings = field(default_factory=MissingRateSettings)
    dependence: DependenceSettings = field(default_factory=DependenceSettings)
    description: DescriptionSettings = field(default_factory=DescriptionSettings)
    resemblance: ResemblanceSettings = field(default_factory=ResemblanceSettings)
    shape: ShapeSettings = field(default_factory=ShapeSettings)

    def __post_init__(self) -> None:
        check_share(self, "learned_from")

    @property
    def fit(self) -> FitSettings:
        return self.search.fit

    @property
    def predict(self) -> PredictSettings:
        return self.search.predict

    @property
    def data(self) -> DataSettings:
        return self.search.data
