"""Settings of a comparison."""

from dataclasses import dataclass, field

from residual_mpc.diagnosis.checks import check_positive, check_share
from residual_mpc.diagnosis.results.settings import ResultSettings


@dataclass(frozen=True)
class ContrastSettings:
    """unit: s, the shortest stretch of a run that counts as one observation; units: number of stretches into which a
    set is cut if it has fewer runs; fewest: number of stretches that a set must have. level: probability of a false
    change, over all hypotheses together; of_size: share of it for the sizes of the residuals; left: the same for a
    difference beyond the named changes; unsized: for a change whose intervals all include "unchanged"; outliers: for a
    share of outliers. of_runs: the smallest p that the divisions of the runs can give has to be at most this for what a
    change explains in them to be tested; of_differences: the same for the differences. lots: maximum number of
    divisions that are tried; run_lots: the same where the runs' scatter is measured in each; labellings: number of ways
    to divide the runs, below which stretches are divided; divisions: number of ways to divide the stretches, below
    which Student's distribution is used; clip: standard deviations at which residuals are clipped.
    units_per_condition: number of units needed for each component of the commands that the test adjusts for; balanced:
    largest difference between the sets' means of such a component, in standard deviations."""

    unit: float = 3.0
    units: int = 12
    fewest: int = 3
    level: float = 0.04
    of_size: float = 0.2
    left: float = 0.01
    unsized: float = 0.01
    outliers: float = 0.01
    of_runs: float = 0.03
    of_differences: float = 0.01
    lots: int = 2000
    run_lots: int = 500
    labellings: int = 10_000
    divisions: int = 1_000
    clip: float = 1.5
    units_per_condition: int = 25
    balanced: float = 0.5

    def __post_init__(self) -> None:
        check_positive(self, "unit", "units", "fewest", "lots", "run_lots", "labellings", "divisions", "clip",
                       "units_per_condition", "balanced")  # fmt: skip
        check_share(self, "level", "of_size", "left", "unsized", "outliers", "of_runs", "of_differences")


@dataclass(frozen=True)
class AccountSettings:
    """A search that keeps one set of effects at a time. largest: maximum number of effects in the account; steps:
    simulation steps that one hypothesis may cost; steps_of_equations: the same for a model that consists of a few
    equations and accepts any step; shortlist: starts that are fitted roughly at each step; finalists: starts that are
    fitted to convergence. further: maximum number of effects that are added beside the changes; worth: likelihood ratio
    that each of their numbers needs; noise exceeds it for one of a hundred effects in one search of a hundred."""

    largest: int = 5
    steps: int = 12_000
    steps_of_equations: int = 30_000
    shortlist: int = 8
    finalists: int = 3
    further: int = 3
    worth: float = 15.0

    def __post_init__(self) -> None:
        check_positive(self, "largest", "steps", "steps_of_equations", "shortlist", "finalists", "further", "worth")


@dataclass(frozen=True)
class ChangeSearchSettings:
    """shortlist: hypotheses that are fitted roughly at each step; finalists: hypotheses that are fitted to convergence;
    rough: steps of a rough fit; most: maximum number of changes. needed: minimum likelihood ratio of a change; alike:
    likelihood ratio below which two sets of changes are not distinguished, if the rival explains at least the share
    `resembles` of what the change explains; hardly: the same for two effects that imitate each other: what neither
    explains may favour either; equal: likelihood ratio below which the first in the contract's table is
    preferred; exchanges: a pair is fitted in place of two changes if a Gauss-Newton step predicts a cost of at most
    this times that of the changes; rivals: number of rivals that are compared with a change beside the same model
    errors; far_worse: ratio of the residuals of every later run to those of every run before, above which a search that
    found nothing begins again from the model of the runs before; dominant: share of the cost that a single change has
    to remove for its fit to speak for it where no test is significant. steps: simulation steps that one hypothesis may
    cost in the search;
    final_steps: the same in the last fit and the tests."""

    shortlist: int = 14
    finalists: int = 6
    rough: int = 3
    most: int = 4
    needed: float = 6.0
    alike: float = 4.0
    hardly: float = 20.0
    resembles: float = 0.5
    equal: float = 1.5
    exchanges: float = 1.5
    rivals: int = 4
    far_worse: float = 2.0
    dominant: float = 0.5
    steps: int = 40_000
    final_steps: int = 100_000

    def __post_init__(self) -> None:
        check_positive(self, "shortlist", "finalists", "rough", "most", "needed", "alike", "hardly", "resembles",
                       "equal", "exchanges", "rivals", "far_worse")  # fmt: skip
        check_positive(self, "steps", "final_steps")
        check_share(self, "dominant")


@dataclass(frozen=True)
class ComparisonSettings:
    """sure: the largest probability of a change; sure_partial: where the sets differ by more than the named changes,
    times the share that these explain; named: if that product is lower, no change is named; doubtful: of a change with
    a number at a bound, one whose intervals contain no change, one that its fit alone speaks for, or one that explains
    less than the share `faint` of what all changes explain: the model predicts no large change better than that.
    unexplained: share of the rise that may be left where the changes are to explain it. rises: ratio of the gap after
    to the gap before above which the verdict is `unknown` instead of `same`, where every later run fits far worse or
    the sets differ; risen: the same where the rise is beyond what runs of one set differ, as other motions alone may
    make it.
    unlike: ratio between the sets of the size or the speed of the commands, from which the test adjusts for them, and
    a note says that they differ where the gap after is more than `worse` times that before or changes leave something;
    with such a gap, changes that leave more than half of the rise do not count as explaining it.
    suspected: p up to which the change that is nearest to being significant is noted where none is. hidden: of what
    all model errors beyond the noise would make of a change if they pointed in its direction, the part that its
    interval allows for. folds: of the cross-validation."""

    sure: float = 0.97
    sure_partial: float = 0.8
    doubtful: float = 0.45
    faint: float = 0.05
    named: float = 0.3
    unexplained: float = 0.3
    rises: float = 3.0
    risen: float = 1.25
    unlike: float = 1.5
    worse: float = 1.5
    suspected: float = 0.3
    hidden: float = 0.1
    folds: int = 4
    account: AccountSettings = field(default_factory=AccountSettings)
    contrast: ContrastSettings = field(default_factory=ContrastSettings)
    search: ChangeSearchSettings = field(default_factory=ChangeSearchSettings)
    results: ResultSettings = field(default_factory=ResultSettings)

    def __post_init__(self) -> None:
        check_share(self, "sure", "sure_partial", "doubtful", "faint", "named", "unexplained", "suspected", "hidden")
        check_positive(self, "rises", "risen", "unlike", "worse", "folds")
