"""How hard a search looks, and what counts as found."""

from dataclasses import asdict, dataclass, field, replace

from residual_mpc.diagnosis.checks import check_positive, check_share
from residual_mpc.diagnosis.data.settings import DataSettings
from residual_mpc.diagnosis.fit.settings import FitSettings
from residual_mpc.diagnosis.predict.settings import PredictSettings


@dataclass(frozen=True)
class ScreenSettings:
    """The screening replays each probe on windows worth `steps` simulation steps, at least `fewest` of them (for a
    first look fewest_quick), cut in half where they are longer than `shortest` s and no less than the share `late` of
    what is left shows in the first halves. growth: of the whole window's cost over the half's, relative to samples:
    between a drift and a steady offset. clear: times what a probe has to move that leave no doubt from few windows.
    many: simulation steps that all probes may cost before the worse of them are looked at less closely."""

    steps: int = 6_000
    fewest: int = 12
    fewest_quick: int = 6
    shortest: float = 0.6
    late: float = 0.1
    growth: float = 3.0
    clear: float = 4.0
    many: int = 1_000_000

    def __post_init__(self) -> None:
        check_positive(self, "steps", "fewest", "fewest_quick", "shortest", "growth", "clear", "many")
        check_share(self, "late")


@dataclass(frozen=True)
class AdditionSettings:
    """hopeless: likelihood ratio beyond which a set is not fitted to the end. rough: steps of a fit that has to rank;
    early: times the margin by which what was fitted on part of the windows may lie behind on the whole. probes: of one
    effect that are fitted. promising: one in so many probes of the best set is tried on the beam's other sets as well,
    where a glance takes over once their probes cost more than glance_from simulation steps. generous: a fit may find
    this many times the drop that the screening's line search promises. inside: shares of the range at which a number
    begins again that says how an effect acts and rests at a bound; again: steps of these fits."""

    hopeless: float = 150.0
    rough: int = 3
    early: float = 1.5
    probes: int = 2
    promising: int = 3
    glance_from: int = 150_000
    generous: float = 4.0
    inside: tuple[float, ...] = (0.15, 0.5)
    again: int = 12

    def __post_init__(self) -> None:
        check_positive(self, "again")
        check_positive(self, "hopeless", "rough", "early", "probes", "promising", "glance_from", "generous")


@dataclass(frozen=True)
class PairSettings:
    """sought: whether pairs are looked for at all; always: also if the best single effect leaves little. sketched:
    probes of each effect that go into every pair; closely: pairs of effects of which all probes are combined. tried:
    pairs that are fitted; each: how many of these may hold one effect."""

    sought: bool = True
    always: bool = False
    sketched: int = 4
    closely: int = 8
    tried: int = 6
    each: int = 2

    def __post_init__(self) -> None:
        check_positive(self, "sketched", "closely", "tried", "each")


@dataclass(frozen=True)
class StepSettings:
    """alike: likelihood ratio below which two sets count as not told apart. Of these, the first `trimmed` are tried
    without each of their effects; one that is worth less than the ratio `needed` goes. At the end of a search, sets of
    at most `together` effects (the cost grows with their cube) are fitted without each effect for thorough_steps; one
    that is worth more than the ratio `needless` on the way is needed. met: sets that a step came across, which are
    kept to be judged on all windows. far_from_floor: times the squared noise floor,
    from which a sizeable addition needs less evidence; visible: likewise, from which a search goes on as if nothing
    else differed, for what leaves a far smaller gap. much: of the squared gap that the best single effect has to
    leave before pairs are tried. beyond_step: times the squared error of the model's own time step, up to which an
    effect that removes no more may stand for it; lasting: share of what it removes that it has to remove from models
    with an infinitely small step too."""

    alike: float = 10.0
    trimmed: int = 3
    needed: float = 4.0
    together: int = 4
    thorough_steps: int = 12
    needless: float = 60.0
    met: int = 4
    far_from_floor: float = 4.0
    visible: float = 16.0
    much: float = 0.25
    beyond_step: float = 4.0
    lasting: float = 0.5

    def __post_init__(self) -> None:
        check_positive(
            self, "alike", "trimmed", "needed", "together", "thorough_steps", "needless", "met", "far_from_floor"
        )
        check_positive(self, "beyond_step", "visible")
        check_share(self, "much", "lasting")


@dataclass(frozen=True)
class RivalSettings:
    """A rival is alike where its likelihood ratio, per_knob added for each number, is below StepSettings.alike and it
    misses no more than the share `parallel` of what the replaced effect contributes. resembles: of the drop that the
    replaced effect itself promises in the screening, from which a candidate is fitted; looked_at: at most. best:
    targets alone that are fitted in place of all. far: likelihood ratio beyond which a rival is not fitted to the end:
    it would hold no probability. better: ratio below which a rival takes the place, `swaps` times at most. visible,
    share: times the squared noise floor and of the squared gap, by which a rival's gap may be larger; gap_steps: of the
    fits that tell it. lost: squared scaled error at which a window counts (1: all of its motion is missed), and
    far_smaller: times the squared gap on all windows below which a rival takes the place there. of_left: of the squared
    gap beyond the noise floor, by which effects have to differ that imitate each other, or whose likelihood ratio is
    below `hardly`; works: of what one of them
    removes of the squared gap, that the other has to remove; wide_steps: iterations when a low-pass of the
    readings and its rival are refitted with the larger uncertainty of the start. law: smallest half-width of a number's
    interval, relative to it; other_start: times the squared gap on all windows, below which a search from another start
    counts; part_left: of the nominal gap, from which one is made where the gap that is left is small."""

    parallel: float = 0.08
    per_knob: float = 2.0
    resembles: float = 0.3
    looked_at: int = 8
    best: int = 2
    far: float = 70.0
    better: float = -6.0
    swaps: int = 2
    visible: float = 0.25
    share: float = 0.1
    gap_steps: int = 3
    lost: float = 1.0
    far_smaller: float = 0.6
    of_left: float = 0.5
    hardly: float = 20.0
    falling: float = 0.05
    leaner: float = 350.0
    works: float = 0.5
    wide_steps: int = 3
    law: float = 0.03
    other_start: float = 0.8
    part_left: float = 0.2

    def __post_init__(self) -> None:
        check_positive(self, "of_left", "hardly", "leaner", "parallel", "looked_at", "best", "far", "visible")
        check_positive(self, "gap_steps", "lost", "wide_steps")
        check_share(self, "resembles", "share", "far_smaller", "falling", "works", "law", "other_start",
                    "part_left")  # fmt: skip


@dataclass(frozen=True)
class UnmarginalisedThresholds:
    """Stricter thresholds for likelihoods in which small differences elsewhere are not marginalised; the fields are
    those of SearchSettings."""

    beyond_doubt: float = 25.0
    per_knob: float = 3.0
    sizeable: float = 0.2
    beyond_doubt_sizeable: float = 8.0
    beyond_doubt_most: float = 6.0
    share: float = 0.1


@dataclass(frozen=True)
class SearchSettings:
    """How hard to look, and what counts as found.

    beyond_doubt: likelihood ratio (drop in cost over dispersion) per added term, on top of `per_knob` for each knob;
    over_floor: an addition has to remove this multiple of the squared noise floor, below which nobody would see it;
    over_floor_longer: likewise over the longer horizons, where what adds up slowly shows;
    sizeable: share of the squared gap beyond the floor for which `beyond_doubt_sizeable` will do, where the gap is more
    than twice the floor; most, beyond_doubt_most: likewise for an effect that closes most of what is left;
    shortlist: starts that are fitted roughly per step, finalists: to the end; largest: terms in a set, largest_longer:
    once longer horizons are searched; beam: sets that a step starts from while more than the share `settled` of the
    squared gap beyond the floor is unexplained; share: of the squared gap beyond the floor that an addition has to
    remove; visible: whitened norm below which even an effect's strong dose stays within the noise.
    """

    beyond_doubt: float = 14.0
    per_knob: float = 3.0
    over_floor: float = 0.2
    over_floor_longer: float = 0.1
    sizeable: float = 0.25
    beyond_doubt_sizeable: float = 8.0
    most: float = 0.5
    beyond_doubt_most: float = 6.0
    shortlist: int = 10
    finalists: int = 5
    largest: int = 7
    largest_longer: int = 9
    beam: int = 4
    settled: float = 0.08
    share: float = 0.0
    visible: float = 6.0
    fit: FitSettings = field(default_factory=FitSettings)
    screen: ScreenSettings = field(default_factory=ScreenSettings)
    additions: AdditionSettings = field(default_factory=AdditionSettings)
    pairs: PairSettings = field(default_factory=PairSettings)
    steps: StepSettings = field(default_factory=StepSettings)
    rivals: RivalSettings = field(default_factory=RivalSettings)
    unmarginalised: UnmarginalisedThresholds = field(default_factory=UnmarginalisedThresholds)

    def __post_init__(self) -> None:
        check_positive(self, "shortlist", "finalists", "largest", "largest_longer", "beam", "visible")
        check_share(self, "settled", "share")

    @property
    def predict(self) -> PredictSettings:
        return self.fit.predict

    @property
    def data(self) -> DataSettings:
        return self.fit.data

    def without_tolerances(self) -> "SearchSettings":
        """Stricter, for likelihoods in which small differences elsewhere are not marginalised."""
        return replace(self, **asdict(self.unmarginalised))
