"""What a diagnosis may be told."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from residual_mpc.diagnosis.checks import check_positive
from residual_mpc.diagnosis.data.hold_out import KeptBack
from residual_mpc.diagnosis.results.settings import ResultSettings
from residual_mpc.models.settings import Term, Values

Progress = Callable[[str, float], None]  # told what is done now, and the share of it all that is behind


@dataclass(frozen=True)
class PhaseSettings:
    """Longer windows are searched in any case where they span at least `blocks` stretches of time and a hypothesis
    costs at most `cheap` steps of a model of equations on them; else only where there is a gap to explain and a
    hypothesis costs at most `bearable` steps on `blocks` windows; what may be a gap is searched on `few` windows or
    more, what is one for certain on any number. lost: gap from which predictions over longer windows have nothing to do
    with the motion, so that they are not searched. near: times the noise floor within which longer
    windows sharpen the numbers of the last fit. marginal_steps: steps of the last fit with small differences, from
    where the plain one ended; marginal_cost: simulation steps that the columns of all small differences may cost;
    marginal_columns: numbers in them (memory); beyond either, fewer windows are taken. outliers_worth: times the
    squared noise floor that a few jumping samples have to make of the gap to be a cause. first_look: simulation steps
    that the first look may cost; most_steps: that one hypothesis may cost on all windows that fits may see, of which
    evenly fewer are taken where a log is long."""

    blocks: int = 10
    cheap: int = 30_000
    bearable: int = 20_000
    few: int = 5
    lost: float = 1.0
    near: float = 2.0
    marginal_steps: int = 4
    marginal_cost: int = 4_000_000
    marginal_columns: int = 10_000_000
    outliers_worth: float = 0.6
    first_look: int = 120_000
    most_steps: int = 150_000

    def __post_init__(self) -> None:
        check_positive(self, "blocks", "cheap", "bearable", "few", "lost", "near", "marginal_steps", "marginal_columns")
        check_positive(self, "marginal_cost", "outliers_worth", "first_look", "most_steps")


@dataclass(frozen=True)
class Options:
    """horizon s; only, without: effect names; without_because: hypotheses that are left out, each with the reason (see
    `not_commanded`); held_out: the runs or blocks to hold out, None to have them chosen; start: the numbers of an
    earlier explanation, which the search begins with and may drop.

    search_steps: simulation steps that one hypothesis may cost in the search (windows are thinned evenly to that);
    final_steps: likewise in the last fit but for its last steps, and half of it in the shares of the stages; a perfect
    model may cost 24 times that. settings, phases: what tunes the method, all of it.
    """

    horizon: float = 1.0
    only: tuple[str, ...] = ()
    without: tuple[str, ...] = ()
    without_because: Mapping[Term, str] = field(default_factory=dict)
    held_out: tuple[KeptBack, ...] | None = None
    start: Values = field(default_factory=dict)
    search_steps: int = 16_000
    final_steps: int = 100_000
    settings: ResultSettings = field(default_factory=ResultSettings)
    phases: PhaseSettings = field(default_factory=PhaseSettings)
