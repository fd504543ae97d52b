"""Which of several changes explains more: the likelihood ratios between them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from residual_mpc.comparison.contrast import contrasts
from residual_mpc.comparison.settings import ContrastSettings
from residual_mpc.comparison.units import Units
from residual_mpc.diagnosis.fit.least_squares import Fit
from residual_mpc.diagnosis.predict.problem import Problem
from residual_mpc.models.settings import Term


@dataclass(frozen=True, eq=False)
class Explanation:
    """fit: the model with the change `term`; dropped (W,): by how much the change lowers each window's cost, beside the
    same effect on both sets alike."""

    term: Term
    fit: Fit
    dropped: np.ndarray


def likelihood_ratios(
    problem: Problem, of: Sequence[Explanation], units: Units, phi: float, settings: ContrastSettings
) -> np.ndarray:
    """(n, n) by how much the i-th change explains more than the j-th, negative where it explains less. phi: dispersion
    of the residuals.

    Of two estimates the larger one counts: the cost decides where few stretches agree well, and what each change leaves
    of the other where a few stretches with large errors dominate the cost.
    """
    left = left_beside(problem, of, units, settings) ** 2
    by_test = left.T - left
    by_cost = np.array([[_by_cost(one, other, units, phi) for other in of] for one in of])
    return np.where(np.abs(by_test) > np.abs(by_cost), by_test, by_cost)


def left_beside(problem: Problem, of: Sequence[Explanation], units: Units, settings: ContrastSettings) -> np.ndarray:
    """(n, n) |z| of the j-th change where the i-th is in the model, 0 on the diagonal. A change that is there leaves
    its imitations nothing to explain; an imitation leaves it something."""
    out = np.zeros((len(of), len(of)))
    for i, one in enumerate(of):
        others = {other.term: j for j, other in enumerate(of) if other.term not in one.fit.terms}
        probes = [(term, probe) for term in others for probe in problem.space.probes(term)]
        if not probes:
            continue
        for c in contrasts(problem, one.fit, units, probes, settings).told:
            j = others[c.term]
            out[i, j] = max(out[i, j], abs(c.z))
    return out


def _by_cost(one: Explanation, other: Explanation, units: Units, phi: float) -> float:
    """From the cost, in two ways: by what each change explains, and by what each model leaves. Each model has a common
    error of its own beside the change, so neither difference is the likelihood ratio of the changes: the smaller one
    counts, and 0 where they contradict each other. The numbers of a common error count only in what the model leaves.
    """
    changed = [sum(k.changed for k in x.fit.knobs) for x in (one, other)]
    both = [len(x.fit.knobs) for x in (one, other)]
    explained, left = one.dropped - other.dropped, other.fit.per_window - one.fit.per_window
    ratios = [
        _paired(units.summed(difference), phi, (mine - its) * float(np.log(units.count)))
        for difference, (mine, its) in ((explained, changed), (left, both))
    ]
    return 0.0 if ratios[0] * ratios[1] <= 0.0 else min(ratios, key=abs)


def _paired(difference: np.ndarray, phi: float, more: float) -> float:
    """From differences of the cost (U,) by unit: the geometric mean of their sum over the dispersion, which is cautious
    where residuals are coloured, and of the squared statistic of a test that pairs the units, which is bold where both
    miss the same. more: what the sum has to exceed for further parameters (Vuong 1989, eq. 5.6, with the correction of
    Schwarz). Where the sum is smaller than this correction, the test of the pairs says nothing: two effects that do the
    same to every unit would be told apart by their number of parameters beyond doubt."""
    summed = float(difference.sum())
    total = summed - phi * more
    if abs(summed) < phi * abs(more):
        return total / phi
    spread = float(np.sqrt(len(difference) * np.var(difference, ddof=1)))
    paired = total / max(spread, 1e-12)
    return float(np.sign(total) * np.sqrt(abs(total) / phi) * abs(paired))
