"""How far the sigma points lie from the weights, and how much each counts.

The paper takes its weights from remark 6 of Menner et al., which it does not print. With L weights, points at
sqrt(L) standard deviations (the unscented transform's usual choice, 14 for 203 weights) leave the region where a
network of kinks is anything like its neighbourhood: the differences then describe another network and little is
learned. Here the points lie at `reach` standard deviations whatever L is, as in a central-difference filter.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class SigmaWeights:
    """Points at +- reach columns of the factor of P; w^{c,i} = 1 / (2 reach^2), so that they have covariance P.

    With `curved`, the mean's weights are w^{a,i} = 1 / (2 reach^2) and w^{a,0} = 1 - L / reach^2, right to second
    order; else w^{a,0} = 1 and w^{a,i} = 0: the prediction is that of the mean weights, and the deviations are taken
    from it. `centre` is w^{c,0}, 0 or more, so that S >= C_v and P stays positive.
    """

    reach: float = 1.0
    curved: bool = False
    centre: float = 0.0

    def __post_init__(self) -> None:
        if not self.reach > 0.0 or not self.centre >= 0.0:
            raise ValueError(f"reach must be > 0 and centre >= 0 to keep S positive definite, got {self}")

    def mean_weights(self, size: int) -> tuple[float, float]:
        """(w^{a,0}, w^{a,i}) for `size` weights; w^{a,0} + 2 size w^{a,i} = 1."""
        return (1.0 - size / self.reach**2, self.covariance_weight) if self.curved else (1.0, 0.0)

    @property
    def covariance_weight(self) -> float:
        """w^{c,i} for i > 0."""
        return 0.5 / self.reach**2
