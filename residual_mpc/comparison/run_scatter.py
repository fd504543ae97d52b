"""By how much runs scatter more than their stretches explain, where there are too few runs to divide them anew.

A ratio of variances with so few degrees of freedom is mostly chance. All hypotheses are tested on the same runs, so the
mean square between runs over that within them is shrunk towards the ratio of all of them, by as much as chance explains
how they differ (empirical Bayes; Smyth 2004, section 6.2, with a ratio in place of a variance). Hypotheses that only a
few stretches tell anything about do not count: their ratios say nothing of the runs, and would make all others look
as if they differed at random.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import polygamma, psi

TINY = 1e-300
ALIKE = 1e6  # degrees of freedom of a prior from which no ratio departs
SEEN = 0.5  # of the stretches, which have to tell something of a hypothesis for its ratio to count for the others


@dataclass(frozen=True, eq=False)
class RunScatter:
    """One entry per hypothesis, (N,) each. ratio: variance of the sums over runs, at least 1, relative to what the
    variance of the stretches implies; freedom: degrees of freedom of the variance of the sums."""

    ratio: np.ndarray
    freedom: np.ndarray


def run_scatter(left: np.ndarray, at: np.ndarray, later: np.ndarray, known: int) -> RunScatter:
    """left (U, N): residuals of the stretches for hypotheses of one kind; at (U,): number of each one's run; later (U,)
    bool; known: coefficients of the regression, besides the label."""
    count, n = left.shape
    runs = int(at.max()) + 1
    between, within = runs - 1 - known, count - runs
    others = count - 1 - known
    if between < 1 or within < 1:
        return RunScatter(np.ones(n), np.full(n, float(max(others, 1))))
    centred = left.copy()
    for side in (later, ~later):
        if side.any():
            centred[side] -= centred[side].mean(axis=0)
    summed = np.zeros((runs, n))
    np.add.at(summed, at, centred)
    of_runs = np.sum(summed**2 / np.bincount(at)[:, None], axis=0)
    whole = np.sum(centred**2, axis=0)
    of_stretches = np.maximum(whole - of_runs, 1e-9 * whole)
    seen = (of_runs > TINY) & (of_stretches > TINY)
    own = np.where(seen, of_runs / between / np.maximum(of_stretches / within, TINY), 1.0)
    known_well = seen & (np.count_nonzero(left, axis=0) >= SEEN * count)
    typical = own[known_well] if known_well.any() else own[seen]
    centre, prior = _prior(np.log(typical), between, within)
    f = np.maximum((prior * centre + between * own) / (prior + between), 1.0)
    # stretches of a run that are alike are no more than one observation
    alike = (f - 1.0) / (f - 1.0 + count / runs)
    freedom = 1.0 / (alike**2 / between + (1.0 - alike) ** 2 / others)
    ratio = np.maximum(f * others / (between * f + within), _common(typical, between, within, others))
    return RunScatter(ratio, np.minimum(freedom, prior + between))


def _common(own: np.ndarray, between: int, within: int, others: int) -> float:
    """The ratio of all hypotheses, at least 1, as if the variances of runs and of stretches were independent. They are
    not, so it is too large where runs differ much, by about an eighth; clipped estimates of so few runs have shorter
    tails than Student's distribution expects, and need as much."""
    if not len(own):
        return 1.0
    whole = own * others / (between * own + within)
    bias = psi(0.5 * between) - np.log(0.5 * between) - psi(0.5 * others) + np.log(0.5 * others)
    return max(float(np.exp(np.log(whole).mean() - bias)), 1.0)


def _prior(logarithms: np.ndarray, between: int, within: int) -> tuple[float, float]:
    """The ratio of all hypotheses, as the geometric mean without the bias of its logarithm, and the degrees of freedom
    that it is worth: from the variance of the logarithms, less what chance adds."""
    if not len(logarithms):
        return 1.0, ALIKE
    bias = psi(0.5 * between) - np.log(0.5 * between) - psi(0.5 * within) + np.log(0.5 * within)
    centre = float(np.exp(logarithms.mean() - bias))
    differ = float(logarithms.var()) - float(polygamma(1, 0.5 * between) + polygamma(1, 0.5 * within))
    return centre, ALIKE if differ <= 0.0 else 2.0 * _inverse_trigamma(differ)


def _inverse_trigamma(y: float) -> float:
    """x with trigamma(x) = y, by Newton's method (Smyth 2004, appendix)."""
    x = 0.5 + 1.0 / y
    for _ in range(50):
        value = float(polygamma(1, x))
        step = value * (1.0 - value / y) / float(polygamma(2, x))
        x += step
        if -step / x < 1e-8:
            break
    return x
