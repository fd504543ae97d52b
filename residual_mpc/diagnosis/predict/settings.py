"""What tunes predictions: the start of a window, the longer horizons, the noise floor, small differences."""

from dataclasses import dataclass, field

from residual_mpc.diagnosis.checks import check_positive, check_share
from residual_mpc.diagnosis.data.settings import DataSettings


@dataclass(frozen=True)
class StartSettings:
    """inflation: on the standard deviation of a window's start, whose own noise is also in the window's first
    samples."""

    inflation: float = 3.0

    def __post_init__(self) -> None:
        if self.inflation < 0.0:
            raise ValueError(f"StartSettings.inflation must be >= 0, got {self.inflation}")


@dataclass(frozen=True)
class HorizonSettings:
    """apart: times the horizon before it, from which a longer one says something new; fewest: windows that a horizon
    needs; lengths: s, of windows that fits may see where none of a horizon's length is free; look_steps: simulation
    steps that the first look at a horizon may cost; shorter: length of the fitted windows as a share of
    the headline's horizon, if errors grow too fast to predict longer ones."""

    apart: float = 1.5
    fewest: int = 3
    shorter: float = 0.25
    lengths: tuple[float, ...] = (20.0, 15.0, 10.0, 7.5)
    look_steps: int = 40_000

    def __post_init__(self) -> None:
        check_positive(self, "apart", "fewest", "look_steps")
        check_share(self, "shorter")


@dataclass(frozen=True)
class FloorSettings:
    """luck: probability that the noise of a perfect model exceeds what chance is allowed. margin: a gap within this
    factor of the noise floor is none; channel_margin: likewise in one channel, of which there are several, each with
    less to average; few: windows at which these margins double, since the noise itself is poorly known.
    freedom_per_window: most degrees of freedom that a window's squared error counts as. draws: of the noise, each of at
    most `steps` simulation steps; figure_draws: on all windows, of the floor that `gap` prints; most_draws,
    fewest_draws: of the headline's floor, which hangs on a few windows with poorly measured starts (three draws scatter
    by a fifth), on few and on very many windows. poor_start: times the median of the windows' squared noise, from which
    a window's start is too poorly measured to search on; poor_spread: times the usual spread of the samples that a
    start comes from, beyond which the window is part of every floor, if that holds for at most the share most_poor of
    the windows. sound_from: windows from which a gap has to be beyond the noise without one whose start is wrong."""

    luck: float = 5e-4
    few: float = 5.0
    freedom_per_window: float = 4.0
    margin: float = 1.25
    channel_margin: float = 1.4
    draws: int = 8
    figure_draws: int = 3
    steps: int = 40_000
    poor_start: float = 25.0
    most_draws: int = 24
    fewest_draws: int = 6
    poor_spread: float = 2.5
    most_poor: float = 0.2
    sound_from: int = 4

    def __post_init__(self) -> None:
        check_positive(self, "poor_spread", "sound_from")
        check_share(self, "most_poor")
        check_positive(self, "luck", "few", "freedom_per_window", "margin", "channel_margin", "draws", "steps")
        check_positive(self, "poor_start", "most_draws", "fewest_draws")


@dataclass(frozen=True)
class ToleranceSettings:
    """levels: in units of each number's tolerance, 0 first, of which the likeliest is taken; beyond: log-likelihood by
    which a level has to beat 0, since one number that is a little off is a cause or chance; shapes: values of a number
    that says how an effect acts, from which its directions are made. near: typical steps of each number within which
    the directions are the same."""

    levels: tuple[float, ...] = (0.0, 0.1, 0.2, 0.35, 0.6, 1.0)
    beyond: float = 10.0
    shapes: int = 2
    near: float = 0.1

    def __post_init__(self) -> None:
        check_positive(self, "shapes", "near")
        if not self.levels or self.levels[0] != 0.0:
            raise ValueError(f"ToleranceSettings.levels must begin with 0, got {self.levels}")

    @property
    def marginalised(self) -> bool:
        """Whether small differences may be there at all."""
        return len(self.levels) > 1


@dataclass(frozen=True)
class LongerStepSettings:
    """A search simulates with steps of at most `longest` s where these change the nominal model's predictions by less
    than the share `error` of the motion and `of_left` of what is left, on `windows` of the windows. It gives them up
    where they change a channel by more than `of_left` of what its present hypothesis leaves there."""

    longest: float = 0.01
    error: float = 0.03
    of_left: float = 0.25
    windows: int = 24

    def __post_init__(self) -> None:
        check_positive(self, "longest", "windows", "of_left")
        check_share(self, "error")


@dataclass(frozen=True)
class PredictSettings:
    data: DataSettings = field(default_factory=DataSettings)
    start: StartSettings = field(default_factory=StartSettings)
    horizons: HorizonSettings = field(default_factory=HorizonSettings)
    floor: FloorSettings = field(default_factory=FloorSettings)
    tolerances: ToleranceSettings = field(default_factory=ToleranceSettings)
    longer_steps: LongerStepSettings = field(default_factory=LongerStepSettings)
