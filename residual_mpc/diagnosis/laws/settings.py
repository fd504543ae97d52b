"""What tunes the search for fitted laws, and for ripples of a torque."""

from dataclasses import dataclass, field

from residual_mpc.diagnosis.checks import check_positive, check_share


@dataclass(frozen=True)
class RippleSettings:
    """windows: that a suggestion looks at. noise: times the variance of a sample above which a joint is looked at: the
    start's error counts as well. most: numbers of cycles that are tried, at_once: in one regression, which bounds the
    memory. chance: drop of the sum of squares, in units of the noise's variance, below which the best of many waves may
    be luck. worth: share of what is left beyond the noise that a wave has to predict. waves: of one joint that are
    fitted; joints: that are suggested at a time."""

    windows: int = 96
    noise: float = 2.0
    most: int = 4_000
    at_once: int = 32
    chance: float = 30.0
    worth: float = 0.1
    waves: int = 2
    joints: int = 3

    def __post_init__(self) -> None:
        check_positive(self, "windows", "noise", "most", "at_once", "chance", "waves", "joints")
        check_share(self, "worth")


@dataclass(frozen=True)
class LawSettings:
    """most: laws of one explanation; passes: how many laws and effects are added at most; tried: quantities that a law
    is fitted in before the best is chosen, columns: laws of logged columns beside them. windows: that a proposal looks
    at; steps: simulation steps that one hypothesis may cost in the fits that choose, of `fit_steps` steps each,
    `shape_steps` for a richer shape. knots: of a curve; places: at which a step or bend is tried; widths: of a step or
    a saturation, of the quantity's range. as_well: share of the squares that the best shape leaves on unseen blocks, by
    which a simpler one may leave more. other_target: share of the main component's gain from which a law that belongs
    to no joint is tried at another one as well. worth: share by which the gap on held-out windows, and the squared one
    on folds, has to shrink; sure: standard errors that are beyond doubt. instead: share of the squares that named
    effects explain, by which laws that do without one of them, and need as many terms, have to explain more."""

    most: int = 2
    passes: int = 5
    tried: int = 4
    columns: int = 8
    windows: int = 160
    floor_draws: int = 2
    steps: int = 12_000
    fit_steps: int = 5
    shape_steps: int = 15
    knots: int = 8
    places: int = 11
    widths: tuple[float, ...] = (0.02, 0.1, 0.2, 0.3, 0.45, 0.6)
    as_well: float = 0.1
    other_target: float = 0.4
    worth: float = 0.1
    sure: float = 2.0
    instead: float = 0.005
    ripples: RippleSettings = field(default_factory=RippleSettings)

    def __post_init__(self) -> None:
        check_positive(self, "most", "passes", "tried", "columns", "windows", "floor_draws")
        check_positive(self, "steps", "fit_steps", "shape_steps", "places", "sure")
        check_share(self, "as_well", "other_target", "worth", "instead")
        if not 3 < self.knots <= 10:
            raise ValueError(f"LawSettings.knots must be from 4 to 10, got {self.knots}")
