"""What the UKF and the EKF share: the belief over the weights, and the correction from a prediction's moments.

The weights are a random walk, so their predicted mean is the mean and their predicted covariance P + C_theta exactly:
the paper's eqs. (UKF f, g) put sigma points through the identity and get the same.
"""

from dataclasses import dataclass

import numpy as np

ROUNDING = 4.0 * np.finfo(np.float64).eps
ILL = 1e8  # ratio of the innovation's variance to the noise's from which a downdate is checked


@dataclass(frozen=True, eq=False)
class Belief:
    """Weights (L,) and their covariance P_t|t (L, L), symmetric and positive definite; unitless."""

    mean: np.ndarray
    covariance: np.ndarray


@dataclass(frozen=True, eq=False)
class Measurement:
    """Stacked references x_ref (m,), NaN where missing, and their noise C_v: (m,) variances or (m, m).

    Both carry the units of what the window predicts, cost weights included.
    """

    reference: np.ndarray
    noise: np.ndarray


@dataclass(frozen=True)
class FilterSettings:
    """How the weights move and how far a sample is believed.

    process: variance that each weight's random walk gains in one update, C_theta = process * I; the square root is
        how far a weight of unit size may wander in an update.
    huber: standard deviations of the innovation from which a sample's pull no longer grows: the robust update against
        spikes. Infinity switches it off. A pull that is bounded, but never nothing, still follows a robot that changed.
    """

    process: float = 1e-7
    huber: float = 3.0

    def __post_init__(self) -> None:
        if not (np.isfinite(self.process) and self.process >= 0.0):
            raise ValueError(f"process {self.process} came, a variance of 0 or more was wanted")
        if not self.huber > 0.0:
            raise ValueError(f"huber {self.huber} came, a positive number of standard deviations was wanted (inf: off)")


@dataclass(frozen=True, eq=False)
class Info:
    """What one update did: innovation x_ref - x_pred (m,), NaN where missing; its variance (m,); how many samples were
    held back by the robust update; whether anything was used at all."""

    innovation: np.ndarray
    variance: np.ndarray
    held_back: int
    used: bool


def start(mean: np.ndarray, variance: float | np.ndarray) -> Belief:
    """The belief before any data: weights `mean` (L,), independent, each with `variance`, a number or (L,).

    Raises ValueError for a variance that is not positive.
    """
    spread = np.broadcast_to(np.asarray(variance, dtype=np.float64), mean.shape)
    if not (np.isfinite(spread).all() and (spread > 0).all() and np.isfinite(mean).all()):
        raise ValueError("finite weights and positive variances were wanted: a weight without doubt learns nothing")
    return Belief(np.array(mean, dtype=np.float64), np.diag(spread))


def predicted_covariance(belief: Belief, settings: FilterSettings, out: np.ndarray | None = None) -> np.ndarray:
    """P_t|t-1 = P + C_theta (L, L), eq. (UKF f); exact for a random walk. Written into `out` where that is given."""
    if out is None:
        out = np.empty(belief.covariance.shape)
    np.copyto(out, belief.covariance)
    out.reshape(-1)[:: len(out) + 1] += settings.process
    return out


def lower_factor(p: np.ndarray, out: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """(p, A) with A A' = p, A lower triangular; p (L, L) is mended first where rounding left it indefinite.

    A is written into `out` (L, L), in columns, where that is given.
    """
    from scipy.linalg.lapack import dpotrf

    if out is None:
        out = np.empty(p.shape)
    np.copyto(out, p)
    factor, failed = dpotrf(out.T, lower=1, clean=1, overwrite_a=1)
    if not failed:
        return p, factor
    value, vector = np.linalg.eigh(0.5 * (p + p.T))
    least = ROUNDING * len(p) * max(value[-1], np.finfo(np.float64).tiny)
    p = (vector * np.maximum(value, least)) @ vector.T
    p = 0.5 * (p + p.T)
    p.reshape(-1)[:: len(p) + 1] += least
    return p, np.linalg.cholesky(p)


def correct(
    mean: np.ndarray,
    p: np.ndarray,
    predicted: np.ndarray,
    cross: np.ndarray,
    spread: np.ndarray,
    measured: Measurement,
    settings: FilterSettings,
) -> tuple[Belief, Info]:
    """The Kalman correction: weights (L,), P_t|t-1 (L, L), predicted (m,), cross C_sz (L, m), spread S - C_v (m, m).

    Missing references drop out. `mean` and `p` may be kept in the answer, `cross` is overwritten. What cannot be used
    (nothing finite, a prediction that overflowed) leaves the weights where they were, with P_t|t-1.
    """
    from scipy.linalg.blas import dtrsm
    from scipy.linalg.lapack import dpotrf

    innovation = measured.reference - predicted
    good = np.isfinite(innovation)
    if not good.all():
        predicted, cross, spread = predicted[good], cross[:, good], spread[np.ix_(good, good)]
    e = innovation[good]
    noise = measured.noise
    s = spread.copy()
    if noise.ndim == 2:
        s += noise if good.all() else noise[np.ix_(good, good)]  # (UKF b)
    else:
        s.reshape(-1)[:: len(e) + 1] += noise[good]
    variance = np.full(innovation.shape, np.nan)
    nothing = Belief(mean, p), Info(innovation, variance, 0, False)
    if not len(e) or not np.isfinite(s).all():
        return nothing
    variance[good] = np.diagonal(s)
    size = np.abs(e) / np.sqrt(np.diagonal(s))
    far = size > settings.huber
    held_back = int(far.sum())
    if held_back:  # Huber's weight huber / size, as more noise on this sample
        s[far, far] *= size[far] / settings.huber
    root, failed = dpotrf(s.T, lower=1, clean=1)
    if failed:
        return nothing
    # K = C_sz S^-1 (UKF a) is never formed: with S = R R' and V = C_sz R^-T, K S K' = V V' and K e = V (R^-1 e)
    v = dtrsm(1.0, root, cross.T, side=0, lower=1, overwrite_b=1).T  # (L, m)
    moved = mean + v @ dtrsm(1.0, root, e[:, None], side=0, lower=1)[:, 0]  # eqs. (learning_law), (UKF)
    after = v @ v.T
    np.subtract(p, after, out=after)  # (UKF h), symmetric bit for bit
    # a downdate is off by up to L eps |P|: so much is given back, and P stays positive
    after.reshape(-1)[:: len(after) + 1] += ROUNDING * len(p) * np.max(np.diagonal(p))
    quietest = np.min(noise[good] if noise.ndim == 1 else np.diagonal(noise)[good])
    if np.max(np.diagonal(s)) > ILL * quietest:  # so little of P is left that rounding shows: look, and mend
        after, _ = lower_factor(after)
    if not (np.isfinite(moved).all() and (np.diagonal(after) > 0.0).all()):
        return nothing
    return Belief(moved, after), Info(innovation, variance, held_back, True)
