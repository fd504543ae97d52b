"""What tunes a confirmation."""

from dataclasses import dataclass, field

from residual_mpc.diagnosis.checks import check_positive, check_share
from residual_mpc.diagnosis.results.settings import ResultSettings


@dataclass(frozen=True)
class ConfirmationSettings:
    """beyond_doubt: likelihood ratio by which new runs exclude an explanation, or need an effect; steps: simulation
    steps that one hypothesis may cost on the windows that are fitted; fit_steps: of each fit; varies: 1-sigma by which
    the size of an effect may differ from one motion to another, relative to the effect, beside its interval; explains:
    share of the nominal model's squared gap that the fitted model has to remove, or else the runs deny no effect;
    shown: 1-sigma above which the runs do not show a number, relative to its expected size.

    agrees, denies: how often new runs agree with an effect, or deny it, where the robot has it and where it has not.
    The odds of an effect are multiplied by the ratio of the two (Bayes' rule).
    """

    beyond_doubt: float = 14.0
    steps: int = 60_000
    fit_steps: int = 12
    varies: float = 0.1
    explains: float = 0.5
    shown: float = 3.0
    agrees: tuple[float, float] = (0.5, 0.1)
    denies: tuple[float, float] = (0.04, 0.2)
    results: ResultSettings = field(default_factory=ResultSettings)

    def __post_init__(self) -> None:
        check_positive(self, "beyond_doubt", "steps", "fit_steps", "varies", "shown")
        check_share(self, "explains")
        for rates in (self.agrees, self.denies):
            if not all(0.0 < rate < 1.0 for rate in rates):
                raise ValueError(f"rates must be between 0 and 1, got {rates}")
