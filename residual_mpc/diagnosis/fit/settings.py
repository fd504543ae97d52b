"""What tunes the fits, the trust in their numbers, and the fit of the noise."""

from dataclasses import dataclass, field

from residual_mpc.diagnosis.checks import check_positive, check_share
from residual_mpc.diagnosis.data.settings import DataSettings
from residual_mpc.diagnosis.predict.settings import PredictSettings


@dataclass(frozen=True)
class LeastSquaresSettings:
    """step: of a derivative, in units of a number's scale: wide, since sampled commands make delays and dead zones
    rough; rough_step: likewise of a robot whose predictions jump, as on contacts; relative_step: the most of a number
    that multiplies the nominal one, which may be a fiftieth of it. most: steps of a fit; secants: of these on a
    Jacobian that is only updated. dampings: factors on the damping that are tried at once, those alone that by the
    Jacobian differ by more than the share `alike` of a step's effect. remaining: times the last drop in cost that a fit
    may still fall (steps that each gain 0.8 of the one before). elsewhere: typical steps of each number by which
    another start lies away."""

    step: float = 0.15
    rough_step: float = 1.0
    relative_step: float = 0.2
    most: int = 8
    secants: int = 2
    dampings: tuple[float, ...] = (1.0, 0.1, 30.0)
    alike: float = 0.02
    remaining: float = 4.0
    elsewhere: float = 1.5

    def __post_init__(self) -> None:
        check_positive(self, "step", "rough_step", "relative_step", "most", "alike", "remaining", "elsewhere")


@dataclass(frozen=True)
class EvidenceSettings:
    """block: s, windows of one run that are closer than this count as one observation. profile: relative offsets at
    which the profile of a threshold's cost is looked at. doubt: an effect whose numbers a region of the probability
    1 - doubt does not tell from none is left out."""

    block: float = 3.0
    profile: tuple[float, ...] = (0.001, 0.0025, 0.005, 0.01, 0.02, 0.04, 0.08, 0.16)
    doubt: float = 0.05

    def __post_init__(self) -> None:
        check_positive(self, "block")
        check_share(self, "doubt")


@dataclass(frozen=True)
class PolishSettings:
    """steps, tolerance: at which a fit to the end ends (relative gain). Where there are many windows, starts are
    compared on one in `coarse` of them until the relative gain coarse_tolerance; the best is fitted for more_steps on
    more windows and for last_steps on all. equally_good: likelihood ratio within which two ends are as good as each
    other."""

    steps: int = 24
    tolerance: float = 1e-6
    coarse: int = 4
    coarse_tolerance: float = 1e-4
    more_steps: int = 8
    last_steps: int = 2
    equally_good: float = 4.0

    def __post_init__(self) -> None:
        check_positive(self, "steps", "tolerance", "coarse", "coarse_tolerance", "more_steps", "last_steps")
        check_positive(self, "equally_good")


@dataclass(frozen=True)
class RidgeSettings:
    """ridges: of which cross-validation chooses; harmonics: of each position: cogging and eccentric wheels repeat with
    the angle."""

    ridges: tuple[float, ...] = tuple(10.0**k for k in range(-3, 6))
    harmonics: int = 2


@dataclass(frozen=True)
class NoiseFitSettings:
    """times: s, correlation times that noise may have; slower errors count as the model's. draws: of each part, from
    which the increments that it would leave are measured, on at most `windows` windows. orders, strides: of the
    differences that bound the noise; leeway: factor on these bounds, in squares, for their own error. excess: how much
    more a noise above the measured increments weighs than one below; rounds: of this reweighting. beyond_white: drop in
    misfit from which a channel's noise is coloured; rounded: times its rounding error up to which it is nothing else;
    least_seconds: s of windows below which it counts as white, since a model's error may be as short; fewest_lags: lags
    from which increments tell white noise from coloured; fewest_pairs: of samples that make a mean. learned: windows
    that the regression on the motion looks at. size_rounds: of scaling the noise down to what is left, until every
    factor exceeds `enough`. uneven: ratio of increments in fast and in slow motion up to which an encoder's may be
    noise that is larger than its jitter, but no more than `luck` times what noise reaches in even_draws draws;
    compared: s, the longest increments that are compared for it."""

    times: tuple[float, ...] = (0.03, 0.1, 0.3, 1.0, 3.0)
    draws: int = 3
    windows: int = 48
    orders: tuple[int, ...] = (3, 5, 7)
    strides: tuple[int, ...] = (1, 2, 4, 8)
    leeway: float = 1.15
    excess: float = 30.0
    rounds: int = 12
    beyond_white: float = 8.0
    rounded: float = 1.5
    least_seconds: float = 15.0
    fewest_lags: int = 2
    fewest_pairs: int = 24
    learned: int = 400
    size_rounds: int = 3
    enough: float = 0.98
    uneven: float = 1.5
    even_draws: int = 12
    luck: float = 1.1
    compared: float = 0.35

    def __post_init__(self) -> None:
        check_positive(self, "uneven", "even_draws", "luck", "compared")
        check_positive(self, "draws", "windows", "leeway", "excess", "rounds", "beyond_white", "rounded")
        check_positive(self, "least_seconds", "fewest_lags", "fewest_pairs", "learned", "size_rounds")
        check_share(self, "enough")


@dataclass(frozen=True)
class OmittedSettings:
    """shown: smallest squared size over variance at which the residuals support a small effect; most: how many of them
    are fitted beside the others, one at a time."""

    shown: float = 10.0
    most: int = 4

    def __post_init__(self) -> None:
        check_positive(self, "shown", "most")


@dataclass(frozen=True)
class FitSettings:
    """folds: of the cross-validation."""

    predict: PredictSettings = field(default_factory=PredictSettings)
    least_squares: LeastSquaresSettings = field(default_factory=LeastSquaresSettings)
    evidence: EvidenceSettings = field(default_factory=EvidenceSettings)
    polish: PolishSettings = field(default_factory=PolishSettings)
    ridge: RidgeSettings = field(default_factory=RidgeSettings)
    omitted: OmittedSettings = field(default_factory=OmittedSettings)
    noise: NoiseFitSettings = field(default_factory=NoiseFitSettings)
    folds: int = 6

    def __post_init__(self) -> None:
        check_positive(self, "folds")

    @property
    def data(self) -> DataSettings:
        return self.predict.data
