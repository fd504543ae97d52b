"""What the UKF and the EKF share: the belief over the weights, and the correction from a prediction's moments.

The weights are a random walk, so their predicted mean is the mean and their predicted covariance P + C_theta exactly:
the paper's eqs. (UKF f, g) put sigma points through the identity and get the same.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg.blas import dtrsm
from scipy.linalg.lapack import dpotrf

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
            raise ValueError(f"process must be >= 0, got {self.process}")
        if not self.huber > 0.0:
            raise ValueError(f"huber must be > 0 standard deviations (inf: off), got {self.huber}")


@dataclass(frozen=True, eq=False)
class UpdateInfo:
    """What one update did: innovation x_ref - x_pred (m,), NaN where missing; its variance (m,); how many samples were
    held back by the robust update; whether anything was used at all."""

    innovation: np.ndarray
    variance: np.ndarray
    held_back: int
    used: bool


def initial_belief(mean: np.ndarray, variance: float | np.ndarray) -> Belief:
    """The belief before any data: weights `mean` (L,), independent, each with `variance`, a number or (L,).

    Raises ValueError for a variance that is not positive.
    """
    spread = np.broadcast_to(np.asarray(variance, dtype=np.float64), mean.shape)
    if not (np.isfinite(spread).all() and (spread > 0).all() and np.isfinite(mean).all()):
        raise ValueError("weights must be finite and their variances > 0: a weight with zero variance is never updated")
    return Belief(np.array(mean, dtype=np.float64), np.diag(spread))


def predicted_covariance(belief: Belief, settings: FilterSettings, out: np.ndarray | None = None) -> np.ndarray:
    """P_t|t-1 = P + C_theta (L, L), eq. (UKF f); exact for a random walk. Written into `out` where that is given."""
    if out is None:
        out = np.empty(belief.covariance.shape)
    np.copyto(out, belief.covariance)
    _diagonal(out)[:] += settings.process
    return out


def factored(belief: Belief, settings: FilterSettings, out: np.ndarray | None = None) -> tuple[Belief, np.ndarray]:
    """(belief, A) with A A' = P + C_theta, A (L, L) lower triangular and stored by columns, in `out` where it is given.

    A belief whose P rounding left indefinite is mended first.
    """
    p = predicted_covariance(belief, settings, out)
    factor, failed = dpotrf(p.T, lower=1, clean=1, overwrite_a=1)
    if failed:
        belief = Belief(belief.mean, positive_definite(belief.covariance))
        factor = np.asfortranarray(np.linalg.cholesky(predicted_covariance(belief, settings)))
    return belief, factor


def positive_definite(p: np.ndarray) -> np.ndarray:
    """p (L, L) itself where it is positive definite, else p with its lowest eigenvalues raised to what rounding is."""
    if not dpotrf(p.T, lower=1)[1]:
        return p
    value, vector = np.linalg.eigh(0.5 * (p + p.T))
    least = ROUNDING * len(p) * max(value[-1], np.finfo(np.float64).tiny)
    p = (vector * np.maximum(value, least)) @ vector.T
    p = 0.5 * (p + p.T)
    _diagonal(p)[:] += least
    return p


def _diagonal(p: np.ndarray) -> np.ndarray:
    """The diagonal of p (L, L), in rows, to be written to."""
    return p.reshape(-1)[:: len(p) + 1]


def correct(
    belief: Belief,
    predicted: np.ndarray,
    cross: np.ndarray,
    spread: np.ndarray,
    measured: Measurement,
    settings: FilterSettings,
) -> tuple[Belief, UpdateInfo]:
    """The Kalman correction of P + C_theta: predicted (m,), cross C_sz (L, m), spread S - C_v (m, m).

    Missing references drop out. `cross` is overwritten where it is stored by columns. What cannot be used (nothing
    finite, a prediction that overflowed) leaves the weights where they were, with P + C_theta.
    """
    p, noise = belief.covariance, measured.noise
    e = innovation = measured.reference - predicted
    good = np.isfinite(innovation)
    if not good.all():
        e, cross, spread = innovation[good], cross[:, good], spread[np.ix_(good, good)]
        noise = noise[good] if noise.ndim == 1 else noise[np.ix_(good, good)]
    s = spread + noise if noise.ndim == 2 else spread.copy()  # (UKF b)
    own = _diagonal(s)
    if noise.ndim == 1:
        own += noise
    if not len(e) or not np.isfinite(s).all():
        return predicted_belief(belief, settings), UpdateInfo(innovation, np.full(innovation.shape, np.nan), 0, False)
    variance = np.full(innovation.shape, np.nan)
    variance[good] = own
    size = np.abs(e) / np.sqrt(own)
    far = size > settings.huber
    held_back = int(np.count_nonzero(far))
    if held_back:  # Huber's weight huber / size, as more noise on this sample
        own[far] *= size[far] / settings.huber
    root, failed = dpotrf(s.T, lower=1, clean=1)
    if failed:
        return predicted_belief(belief, settings), UpdateInfo(innovation, variance, 0, False)
    # K = C_sz S^-1 (UKF a) is never formed: with S = R R' and V = C_sz R^-T, K S K' = V V' and K e = V (R^-1 e)
    v = dtrsm(1.0, root, cross, side=1, lower=1, trans_a=1, overwrite_b=1)  # (L, m)
    moved = belief.mean + v @ dtrsm(1.0, root, e, lower=1)  # eqs. (learning_law), (UKF)
    after = v @ v.T
    np.subtract(p, after, out=after)  # (UKF h), symmetric bit for bit, but for C_theta
    # a downdate is off by up to L eps |P|: so much is given back, and P stays positive
    _diagonal(after)[:] += settings.process + ROUNDING * len(p) * (_diagonal(p).max() + settings.process)
    if own.max() > ILL * (noise if noise.ndim == 1 else np.diagonal(noise)).min():
        after = positive_definite(after)  # so little of P is left that rounding shows
    if not (np.isfinite(moved).all() and _diagonal(after).min() > 0.0):
        return predicted_belief(belief, settings), UpdateInfo(innovation, variance, 0, False)
    return Belief(moved, after), UpdateInfo(innovation, variance, held_back, True)


def predicted_belief(belief: Belief, settings: FilterSettings) -> Belief:
    """The belief after an update that nothing was learned from: the same weights, P + C_theta."""
    return Belief(belief.mean, predicted_covariance(belief, settings))
