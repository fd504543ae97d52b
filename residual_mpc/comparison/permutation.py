"""Permutation test: whether two sets of units differ by more than they would under a random relabelling of before and
after.

Each hypothesis gives every unit an estimate. A robust regression (Huber 1981, section 7.6) on the conditions alone
yields a clipped residual per unit; the statistic is the sum of these residuals over the later set, after removing the
part of the labels that the conditions predict. The residuals are permuted among the runs (Freedman and Lane 1983), and
the largest statistic of all hypotheses is compared with its permutation distribution (Westfall and Young 1993,
algorithm 2.8), so that neither heavy tails nor nearly equivalent hypotheses need a correction. If there are too few
runs to permute, the stretches are permuted instead, and the statistic is reduced where runs scatter by more than their
stretches explain.
"""

from dataclasses import dataclass
from itertools import combinations
from math import comb

import numpy as np
from scipy.special import fdtrc, ndtri, stdtr, stdtrit

from residual_mpc.comparison.settings import ContrastSettings
from residual_mpc.comparison.units import Units, averaged

FAINT = 1e-6  # of the most informative unit's size: a unit below it has no estimate
STEPS = 12  # of the robust regression
MAD = 1.4826  # standard deviations in a median absolute deviation of a normal distribution
TINY = 1e-300
POOLED = 0.4  # level of the F test: with a larger p, the stretches count as independent
POWER = float(ndtri(0.8))  # standard deviations beyond the threshold at which the power is 80 %


@dataclass(frozen=True, eq=False)
class Differences:
    """One entry per hypothesis, (N,) each. before: mean estimate of the earlier set; dose: how much larger that of the
    later set is; z: standardised statistic; p: probability that the largest |z| of all hypotheses is at least this
    large by chance; alone: the same for the |z| of this hypothesis by itself; visible: minimum detectable dose, found
    in at least four cases of five."""

    before: np.ndarray
    dose: np.ndarray
    z: np.ndarray
    p: np.ndarray
    alone: np.ndarray
    visible: np.ndarray


def permuted(size: np.ndarray, score: np.ndarray, units: Units, settings: ContrastSettings) -> Differences:
    """size, score (U, N): for each unit and hypothesis, the products of a direction with itself and with the residuals;
    a unit's estimate is -score / size."""
    seen = size > FAINT * size.max(axis=0, initial=TINY)
    estimate = np.where(seen, -score / np.where(seen, size, 1.0), 0.0)
    # even the most informative unit has at most twice the weight of one with the median information
    middle = np.array([np.median(s[m]) if m.any() else 1.0 for s, m in zip(size.T, seen.T, strict=True)])
    weight = np.where(seen, size / (size + middle), 0.0)
    x = np.column_stack([np.ones(units.count), units.conditions - units.conditions.mean(axis=0)])
    dosed, _, slope = _robust(estimate, weight, np.column_stack([x, units.later]), settings.clip)
    _, left, _ = _robust(estimate, weight, x, settings.clip)
    z, lots, widened = _statistics(left, x, units, settings)
    largest = np.abs(lots).max(axis=1, initial=0.0)
    p = np.array([_share_beyond(largest, a) for a in np.abs(z)])
    alone = np.array([_share_beyond(np.abs(lot), a) for lot, a in zip(lots.T, np.abs(z), strict=True)])
    if comb(units.count, int(units.later.sum())) < settings.divisions:
        alone = _student_p(z, units.count - 1 - x.shape[1])
        p = np.minimum(1.0, len(z) * alone)
    sets = [np.count_nonzero(weight[side] > 0.0, axis=0) for side in (units.later, ~units.later)]
    there = np.minimum(*sets) > 0
    visible = _visible(left, slope, largest, widened, x, units, settings)
    return Differences(
        np.where(there, dosed[0], 0.0), np.where(there, dosed[-1], 0.0), z, np.where(there, p, 1.0),
        np.where(there, alone, 1.0), np.where(there, visible, np.inf),
    )  # fmt: skip


def _unforeseen(later: np.ndarray, x: np.ndarray) -> np.ndarray:
    """(n,) the part of the labels (n,) that the conditions x (n, k) do not predict."""
    return np.asarray(later - x @ (np.linalg.pinv(x) @ later.astype(float)))


def _robust(
    y: np.ndarray, weight: np.ndarray, x: np.ndarray, clip: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Huber's regression of y (U, N) on x (U, k): coefficients (k, N); the units' clipped residuals (U, N), in standard
    deviations times the square root of their weights; and the derivatives of these residuals with respect to y."""
    root, w = np.sqrt(weight), weight
    for _ in range(STEPS):
        gram = np.einsum("up,un,uq->npq", x, w, x, optimize=True)
        right = np.einsum("up,un->np", x, w * y)
        b = (np.linalg.pinv(gram, rcond=1e-9, hermitian=True) @ right[..., None])[..., 0].T
        z = root * (y - x @ b)
        there = zip(np.abs(z).T, (weight > 0.0).T, strict=True)
        spread = np.array([np.median(a[m]) if m.any() else 0.0 for a, m in there])
        scale = np.maximum(MAD * spread, np.sqrt(np.mean(z**2, axis=0)) * 1e-3 + TINY)
        z = z / scale
        w = weight * np.minimum(1.0, clip / np.maximum(np.abs(z), TINY))
    return b, root * np.clip(z, -clip, clip), np.where(np.abs(z) < clip, weight / scale, 0.0)


def _statistics(
    left: np.ndarray, x: np.ndarray, units: Units, settings: ContrastSettings
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """z (N,), the statistic of the regression's residuals with the actual labels; lots (L, N), the same under L
    permutations; (N,) the factor, at least 1, by which runs scatter more than their stretches explain."""
    at = np.unique(units.run, return_inverse=True)[1]
    runs = int(at.max()) + 1
    later = np.zeros(runs, dtype=bool)
    later[at] = units.later
    if _many(runs, units, settings):
        summed = np.zeros((runs, left.shape[1]))
        np.add.at(summed, at, left)
        z, lots = _against_lots(summed, averaged(x, at, runs), later, settings)
        return z, lots, np.sqrt(_by_run(left, at, units.later, x.shape[1]))
    z, lots = _against_lots(left, x, units.later, settings)
    ratio = _by_run(left, at, units.later, x.shape[1])
    return _with_few_runs(z, ratio, runs - 1 - x.shape[1], units.count - 1 - x.shape[1]), lots, np.sqrt(ratio)


def _against_lots(
    left: np.ndarray, x: np.ndarray, later: np.ndarray, settings: ContrastSettings
) -> tuple[np.ndarray, np.ndarray]:
    label = _unforeseen(later, x)
    left = left - left.mean(axis=0)
    scale = np.sqrt(np.sum(left**2, axis=0) * np.sum(label**2) / max(len(later) - 1, 1)) + TINY
    return (label @ left) / scale, (_lots(later, label, settings.lots) @ left) / scale


def _lots(later: np.ndarray, label: np.ndarray, most: int) -> np.ndarray:
    """(L, n) the permuted labels: all other divisions of the units into two sets of these sizes, if there are few."""
    n, k = len(later), int(later.sum())
    alike = 0 < k < n and np.ptp(label[later]) + np.ptp(label[~later]) < 1e-12
    if alike and comb(n, k) <= most:
        out = np.full((comb(n, k), n), label[~later][0])
        for i, chosen in enumerate(combinations(range(n), k)):
            out[i, list(chosen)] = label[later][0]
        return out[~(np.abs(out - label).max(axis=1) < 1e-12)]
    return np.random.default_rng(most).permuted(np.tile(label, (most, 1)), axis=1)


def _share_beyond(lots: np.ndarray, a: float) -> float:
    """Share of the permuted statistics (L,) that are at least a, the actual one included."""
    return (1.0 + np.count_nonzero(lots >= a * (1.0 - 1e-9))) / (1.0 + len(lots))


def _student_p(z: np.ndarray, freedom: int) -> np.ndarray:
    """(N,) Student's p of each hypothesis by itself, for too few units to permute."""
    if freedom < 1:
        return np.ones(len(z))
    return np.asarray(2.0 * stdtr(freedom, -np.abs(_student_of(z, freedom))))


def _visible(
    left: np.ndarray,
    slope: np.ndarray,
    largest: np.ndarray,
    widened: np.ndarray,
    x: np.ndarray,
    units: Units,
    settings: ContrastSettings,
) -> np.ndarray:
    """(N,) the minimum detectable dose, with a power of at least 80 %. If there are too few runs to permute, the
    threshold is the one that applies when runs scatter more than their stretches explain."""
    if not len(largest):
        return np.full(left.shape[1], np.inf)
    runs, known = len(np.unique(units.run)), 1 + x.shape[1]
    freedom, by_run = units.count - known, runs - known
    many = _many(runs, units, settings)
    # a change also increases the residuals of the regression, so the statistic itself grows less than Student's
    beyond = np.quantile(largest, [1.0 - settings.level * (1.0 - settings.of_size)])
    threshold = _student_of(beyond, max(by_run if many else freedom, 1))
    if runs < units.count and min(freedom, by_run) > 0 and not many:
        threshold = -stdtrit(by_run, stdtr(freedom, -threshold))
    label = _unforeseen(units.later, x)
    spread = np.sqrt(np.sum(label**2) * np.var(left, axis=0)) * widened
    return np.asarray((threshold[0] + POWER) * spread / np.maximum(np.sum(label[:, None] ** 2 * slope, axis=0), TINY))


def _many(runs: int, units: Units, settings: ContrastSettings) -> bool:
    """Whether there are enough runs to permute."""
    return comb(runs, len(np.unique(units.run[units.later]))) >= settings.labellings


def _by_run(left: np.ndarray, at: np.ndarray, later: np.ndarray, known: int) -> np.ndarray:
    """(N,) ratio of the variance of the sums over runs to the value that the variance of the stretches implies; 1 where
    a preliminary F test accepts the stretches of one run as independent (Bancroft 1964)."""
    runs = int(at.max()) + 1
    freedom = runs - 1 - known
    if freedom < 1:
        return np.ones(left.shape[1])
    centred = left.copy()
    for side in (later, ~later):
        centred[side] -= centred[side].mean(axis=0)
    summed = np.zeros((runs, left.shape[1]))
    np.add.at(summed, at, centred)
    others = len(left) - 1 - known
    by_run = np.sum(summed**2, axis=0) / freedom * runs
    by_stretch = np.sum(centred**2, axis=0) / max(others, 1) * len(left)
    ratio = by_run / np.maximum(by_stretch, TINY)
    return np.where(fdtrc(freedom, max(others, 1), ratio) < POOLED, np.maximum(ratio, 1.0), 1.0)


def _with_few_runs(z: np.ndarray, ratio: np.ndarray, runs: int, stretches: int) -> np.ndarray:
    """The statistic of the stretches if there are too few runs to permute: reduced where runs scatter by more than
    their stretches explain, and adjusted to the tails of Student's distribution with so few degrees of freedom. runs:
    degrees of freedom of the variance of the runs; stretches: of that of the stretches."""
    if runs < 1 or stretches < 1:
        return z
    t = np.abs(_student_of(z, stretches)) / np.sqrt(ratio)
    t = -stdtrit(stretches, np.maximum(stdtr(runs, -t), TINY))
    lower = np.sqrt((stretches + 1) / (stretches + t**2)) * t
    return np.asarray(np.where(ratio > 1.0, np.sign(z) * lower, z))


def _student_of(z: np.ndarray, freedom: int) -> np.ndarray:
    """Student's t from a standardised statistic, which is a correlation times the square root of freedom + 1."""
    share = np.minimum(z**2 / (freedom + 1), 1.0 - 1e-9)
    return np.asarray(np.sign(z) * np.sqrt(freedom * share / (1.0 - share)))
