"""What tunes how runs are cut into windows, and what is held out of them."""

from dataclasses import dataclass, field

from residual_mpc.diagnosis.checks import check_positive, check_share


@dataclass(frozen=True)
class DatasetSettings:
    """lead: s of commands before a window, which warm up effects with memory (a slow ramp begins at the measured speed,
    whose noise stays until the ramp arrives); after: s of commands after it, for
    sensors whose stamps are early. A channel's noise is estimated where it moves: by more than moves_steps times its
    resolution, in more than the share moves_share of its samples."""

    lead: float = 2.4
    after: float = 0.5
    moves_steps: float = 3.0
    moves_share: float = 0.02

    def __post_init__(self) -> None:
        check_positive(self, "lead", "after", "moves_steps")
        check_share(self, "moves_share")


@dataclass(frozen=True)
class TrustSettings:
    """A window's prediction has diverged where its scaled error exceeds both `diverged` (0.5: half of the motion is
    missed) and `typical` times the median window's. To a fit, a window is unlike the others where its scaled error
    exceeds `unlike` times the upper quartile's (a robot may rest in most windows): something happened there, or its
    prediction is about to diverge."""

    diverged: float = 0.5
    typical: float = 4.0
    unlike: float = 8.0

    def __post_init__(self) -> None:
        check_positive(self, "diverged", "typical", "unlike")


@dataclass(frozen=True)
class HoldOutSettings:
    """by_run_from: runs from which whole runs are held out; with fewer, each run's motion may be the only one of its
    kind. share: of these runs. Otherwise one stretch in `every` is held out of each run with at least `fewest` windows:
    `stretch` windows long, so that what happens rarely is on both sides, and long_stretch in a run of `long` windows or
    more, so that it holds a window of the next horizon as well."""

    by_run_from: int = 6
    share: float = 0.25
    stretch: int = 3
    long_stretch: int = 5
    long: int = 30
    every: int = 4
    fewest: int = 4

    def __post_init__(self) -> None:
        check_positive(self, "by_run_from", "stretch", "long_stretch", "long", "every", "fewest")
        check_share(self, "share")


@dataclass(frozen=True)
class UnlikeSettings:
    """windows: of each side that are compared, from `fewest` fitted ones on; usual: share of the fitted windows that
    have one like them in another run; apart: horizons that stretches of a single run take; least: of the range of a
    feature of the drive, the least difference that counts as one unit."""

    windows: int = 1500
    fewest: int = 12
    usual: float = 0.95
    apart: float = 5.0
    least: float = 0.1

    def __post_init__(self) -> None:
        check_positive(self, "windows", "fewest", "apart", "least")
        check_share(self, "usual")


@dataclass(frozen=True)
class UnknownPastSettings:
    """Windows that begin less than `forgotten` s (two of the longest lags) after the first stamp of a run with an
    unknown past are left out of fits, if they are at most the share `most` of those that fits may see, `most_longer`
    over longer horizons. A run begins in motion if the slope of a cubic through the samples of its first
    `seconds`, at least `samples`, exceeds `certain` standard errors; a robot that sets off from rest has hardly moved
    by then."""

    forgotten: float = 1.0
    most: float = 0.25
    most_longer: float = 0.5
    seconds: float = 0.05
    samples: int = 5
    certain: float = 4.0

    def __post_init__(self) -> None:
        check_positive(self, "forgotten", "seconds", "certain")
        check_share(self, "most", "most_longer")
        if not self.samples >= 5:  # a cubic and what it leaves
            raise ValueError(f"UnknownPastSettings.samples must be >= 5, got {self.samples}")


@dataclass(frozen=True)
class OutlierSettings:
    """frequent: share of a channel's samples from which outliers are a cause, whatever they do to the gap; fewest:
    flagged samples below which a share says nothing. far: times the noise, and times the largest step of the samples
    beside, by which an outlier of the position moves a velocity that it spoils, for `longest` samples at most; beside:
    samples on either side that tell what the velocity was."""

    frequent: float = 0.002
    fewest: int = 5
    far: float = 6.0
    longest: int = 12
    beside: int = 5

    def __post_init__(self) -> None:
        check_share(self, "frequent")
        check_positive(self, "fewest", "far", "longest", "beside")


@dataclass(frozen=True)
class SubsamplingSettings:
    """fewest: windows of 1 s that are left, however small the budget of simulation steps (fewer of longer ones);
    fewest_whole: windows that are left where their length is their point."""

    fewest: int = 32
    fewest_whole: int = 10

    def __post_init__(self) -> None:
        check_positive(self, "fewest", "fewest_whole")


@dataclass(frozen=True)
class WhereSettings:
    """worst: stretches of time that are listed; smooth: s over which the rate of a held command is taken; least_time:
    share of the time below which a regime says nothing."""

    worst: int = 6
    smooth: float = 0.05
    least_time: float = 0.005

    def __post_init__(self) -> None:
        check_positive(self, "worst", "smooth")
        check_share(self, "least_time")


@dataclass(frozen=True)
class EncoderSettings:
    """accounts: share of what an effect does to the pose, squared, that the encoders' errors have to account for before
    they contradict it. touched: an effect acts on a wheel if its squared effect there exceeds this share of that on
    the wheel that it turns most."""

    accounts: float = 0.8
    touched: float = 0.01

    def __post_init__(self) -> None:
        check_share(self, "accounts", "touched")


@dataclass(frozen=True)
class WheelAngleSettings:
    """How the angle at which a wheel's radius is the largest is read off a run. stretch: s over which a parabola takes
    out what is no ripple; reach: s around a window, over which the angle turned is taken to be right; stretches: so
    many are wanted there, else the window's own readings count as well; fewest: samples in a stretch."""

    stretch: float = 2.0
    reach: float = 12.0
    stretches: int = 2
    fewest: int = 8

    def __post_init__(self) -> None:
        check_positive(self, "stretch", "reach", "stretches", "fewest")


@dataclass(frozen=True)
class DataSettings:
    dataset: DatasetSettings = field(default_factory=DatasetSettings)
    trust: TrustSettings = field(default_factory=TrustSettings)
    hold_out: HoldOutSettings = field(default_factory=HoldOutSettings)
    outliers: OutlierSettings = field(default_factory=OutlierSettings)
    subsampling: SubsamplingSettings = field(default_factory=SubsamplingSettings)
    where: WhereSettings = field(default_factory=WhereSettings)
    encoders: EncoderSettings = field(default_factory=EncoderSettings)
    wheel_angle: WheelAngleSettings = field(default_factory=WheelAngleSettings)
    unlike: UnlikeSettings = field(default_factory=UnlikeSettings)
    unknown_past: UnknownPastSettings = field(default_factory=UnknownPastSettings)
