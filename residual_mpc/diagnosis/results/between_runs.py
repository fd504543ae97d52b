"""How far the runs disagree about the numbers of the last fit, beyond what the noise within them explains.

The blocks of the sandwich covariance are seconds long. What differs from run to run (how the robot was started, how
warm it is, which motion it makes) is common to all blocks of a run, so they understate it.
"""

import numpy as np
from scipy.special import fdtri, stdtrit

from residual_mpc.diagnosis.fit.evidence import T95
from residual_mpc.diagnosis.fit.least_squares import Fit
from residual_mpc.diagnosis.results.settings import ResultSettings


def sigma_between_runs(
    fit: Fit, run: np.ndarray, within: np.ndarray, blocks: int, settings: ResultSettings
) -> np.ndarray:
    """(P,) 1-sigma of each number, so that 1.96 of it are half of a 95 % interval; `within` where the runs agree.

    The runs are left out one by one (jackknife; Efron 1982, eq. 3.1), each time by one Gauss-Newton step. They
    disagree where that variance exceeds, beyond what chance makes of so few runs (F test), what it would be if nothing
    but the scatter within them moved the numbers. The interval is then Student's for one run less than there are. A run
    that determines a number alone moves it much either way: nothing is said of a number to which only a few of the runs
    contribute (effective number; Satterthwaite 1946).

    Args:
        fit: the last fit.
        run: (W,) the run of each window.
        within: (P,) 1-sigma of each number, as if nothing differed between runs; 0 where it is not known.
        blocks: the number of blocks that `within` rests on.
    """
    tuned, present = settings.causes, np.unique(run)
    n, free = len(present), np.flatnonzero(~fit.held)
    if n < tuned.fewest_runs or not len(free):
        return within
    j = fit.jacobian[:, :, free]
    h = np.stack([np.einsum("wnp,wnq->pq", part, part) for part in (j[run == i] for i in present)])
    g = np.stack([np.einsum("wnp,wn->p", j[run == i], fit.r[run == i]) for i in present])
    whole, inverse = h.sum(axis=0), np.linalg.pinv(h.sum(axis=0), hermitian=True)
    less = [np.linalg.pinv(whole - a, hermitian=True) for a in h]
    moved = np.stack([a @ (b - g.sum(axis=0)) for a, b in zip(less, g, strict=True)])
    # of each run, if its windows scattered as all do: (n, P), in units of the variance of the fit
    alone = np.stack([np.diag(a @ b @ a) for a, b in zip(less, h, strict=True)]) / np.maximum(np.diag(inverse), 1e-300)
    variance = np.var(moved, axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        times = n * variance / ((within[free] / fit.scales[free]) ** 2 * alone.sum(axis=0))
        count = alone.sum(axis=0) ** 2 / (alone**2).sum(axis=0)
    quantile = float(fdtri(n - 1, max(blocks - len(free), 1), 1.0 - tuned.agree))
    disagree = np.isfinite(times) & (count >= tuned.contributing * n) & (times > quantile)
    jackknife = fit.scales[free] * np.sqrt((n - 1) * variance) * stdtrit(n - 1, 0.975) / T95
    out = within.copy()
    out[free] = np.where(disagree, np.maximum(jackknife, within[free]), within[free])
    return out
