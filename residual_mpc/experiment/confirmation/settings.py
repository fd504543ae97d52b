"""Settings of a confirmation."""

from dataclasses import dataclass, field

from residual_mpc.diagnosis.checks import check_positive, check_share
from residual_mpc.diagnosis.results.settings import ResultSettings


@dataclass(frozen=True)
class ConfirmationSettings:
    """beyond_doubt: score difference above which an explanation is excluded or an effect counts as needed; steps:
    maximum simulation steps of a hypothesis on the fitted windows; fit_steps: maximum iterations of a fit; varies:
    standard deviation of the size of an effect between motions, relative to that size, in addition to its interval;
    explains: share of the nominal model's squared gap that the fitted model must remove before an effect in it can be
    denied; shown: standard deviation, relative to the expected size, above which a parameter counts as not determined;
    excluded: share of its probability that an excluded explanation keeps; denied: the most that an effect keeps which
    new runs deny; combinations: of alternatives that exchange different effects, which are tested as well.

    agrees, denies: rates at which new runs agree with or deny an effect that the robot has, and one that it does not
    have. The odds of an effect are multiplied by the ratio of the two (Bayes' rule).
    """

    beyond_doubt: float = 14.0
    steps: int = 60_000
    fit_steps: int = 12
    varies: float = 0.1
    explains: float = 0.5
    shown: float = 3.0
    excluded: float = 0.05
    denied: float = 0.45
    combinations: int = 12
    agrees: tuple[float, float] = (0.5, 0.1)
    denies: tuple[float, float] = (0.04, 0.2)
    results: ResultSettings = field(default_factory=ResultSettings)

    def __post_init__(self) -> None:
        check_positive(self, "beyond_doubt", "steps", "fit_steps", "varies", "shown", "combinations")
        check_share(self, "explains", "excluded", "denied")
        for rates in (self.agrees, self.denies):
            if not all(0.0 < rate < 1.0 for rate in rates):
                raise ValueError(f"rates must be between 0 and 1, got {rates}")
