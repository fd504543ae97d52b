"""Permutation test: whether two sets of units differ by more than they would under a random relabelling of before and
after.

Each hypothesis gives every unit an estimate. A robust regression (Huber 1981, section 7.6) on the conditions alone
yields a clipped residual per unit; the statistic is the sum of these residuals over the later set, after removing the
part of the labels that the conditions predict. The runs are divided anew (Draper and Stoneman 1966), and the largest
statistic of all hypotheses is compared with its distribution over the divisions (Westfall and Young 1993, algorithm
2.8), so that neither heavy tails nor nearly equivalent hypotheses need a correction. If there are too few runs, the
stretches are divided instead, and the statistic is reduced where runs scatter by more than their stretches explain.
"""

from dataclasses import dataclass
from itertools import combinations
from math import comb

import numpy as np
from scipy.special import ndtri, stdtr, stdtrit

from residual_mpc.comparison.run_scatter import RunScatter, run_scatter
from residual_mpc.comparison.settings import ContrastSettings
from residual_mpc.comparison.units import Units, averaged

FAINT = 1e-6  # of the most informative unit's size: a unit below it has no estimate
STEPS = 12  # of the robust regression
MAD = 1.4826  # standard deviations in a median absolute deviation of a normal distribution
TINY = 1e-300
POWER = float(ndtri(0.8))  # standard deviations beyond the threshold at which the power is 80 %


@dataclass(frozen=True, eq=False)
class Differences:
    """One entry per hypothesis, (N,) each. before: mean estimate of the earlier set; dose: how much larger that of the
    later set is; z: standardised statistic; p: probability that the largest |z| of all hypotheses is at least this
    large by chance; alone: the same for the |z| of this hypothesis by itself; visible: minimum detectable dose, found
    in at least four cases of five. Beside them, for other divisions: left (U, N), the clipped residuals of the
    regression on the conditions alone; conditions (U, k), the constant included."""

    before: np.ndarray
    dose: np.ndarray
    z: np.ndarray
    p: np.ndarray
    alone: np.ndarray
    visible: np.ndarray
    left: np.ndarray
    conditions: np.ndarray


def permuted(
    size: np.ndarray, score: np.ndarray, misfit: np.ndarray, units: Units, settings: ContrastSettings
) -> Differences:
    """size, score (U, N): for each unit and hypothesis, the products of a direction with itself and with the residuals;
    a unit's estimate is -score / size. misfit (U, N): mean square of the residuals that are left with it, so that the
    information in an estimate is size / misfit. The last hypothesis is on the size of the residuals."""
    seen = size > FAINT * size.max(axis=0, initial=TINY)
    estimate = np.where(seen, -score / np.where(seen, size, 1.0), 0.0)
    # even the most informative unit has at most twice the weight of one with the median information
    information = size / np.maximum(misfit, 1e-9 * misfit.max(axis=0, initial=0.0) + 1e-30)
    middle = np.array([np.median(s[m]) if m.any() else 1.0 for s, m in zip(information.T, seen.T, strict=True)])
    weight = np.where(seen, information / (information + middle), 0.0)
    x = np.column_stack([np.ones(units.count), units.conditions - units.conditions.mean(axis=0)])
    dosed, _, slope = _robust(estimate, weight, np.column_stack([x, units.later]), settings.clip)
    _, left, _ = _robust(estimate, weight, x, settings.clip)
    z, lots, scatter = _statistics(left, x, units, settings)
    largest = np.abs(lots).max(axis=1, initial=0.0)
    p = np.array([_share_beyond(largest, a) for a in np.abs(z)])
    alone = np.array([_share_beyond(np.abs(lot), a) for lot, a in zip(lots.T, np.abs(z), strict=True)])
    runs = len(np.unique(units.run))
    if _many(runs, units, settings):
        z = _normal_of(z, runs - 1 - x.shape[1], runs)
    elif comb(units.count, int(units.later.sum())) < settings.divisions:
        alone = _student_p(z, units.count - 1 - x.shape[1], units.count)
        p = np.minimum(1.0, len(z) * alone)
    sets = [np.count_nonzero(weight[side] > 0.0, axis=0) for side in (units.later, ~units.later)]
    there = np.minimum(*sets) > 0
    visible = _visible(left, slope, largest, scatter, x, units, settings)
    return Differences(
        np.where(there, dosed[0], 0.0), np.where(there, dosed[-1], 0.0), z, np.where(there, p, 1.0),
        np.where(there, alone, 1.0), np.where(there, visible, np.inf), left, x,
    )  # fmt: skip


def _unforeseen(later: np.ndarray, x: np.ndarray) -> np.ndarray:
    """(..., n) the part of the labels (..., n) that the conditions x (n, k) do not predict."""
    labels = later.astype(float)
    return np.asarray(labels - labels @ np.linalg.pinv(x).T @ x.T)


def _robust(y: np.ndarray, weight: np.ndarray, x: np.ndarray, clip: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Huber's regression of y (U, N) on x (U, k): coefficients (k, N); the units' clipped residuals (U, N), in standard
    deviations times the square root of their weights; and the derivatives of these residuals with respect to y."""
    root, w = np.sqrt(weight), weight
    for _ in range(STEPS):
        gram = np.einsum("up,un,uq->npq", x, w, x, optimize=True)
        right = np.einsum("up,un->np", x, w * y)
        b = (np.linalg.pinv(gram, rcond=1e-9, hermitian=True) @ right[..., None])[..., 0].T
        z = root * (y - x @ b)
        scale = np.maximum(MAD * _medians(np.abs(z), weight > 0.0), np.sqrt(np.mean(z**2, axis=0)) * 1e-3 + TINY)
        z = z / scale
        w = weight * np.minimum(1.0, clip / np.maximum(np.abs(z), TINY))
    return b, root * np.clip(z, -clip, clip), np.where(np.abs(z) < clip, weight / scale, 0.0)


def _medians(x: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """(N,) the medians of the seen entries of each column of x (U, N); 0 where none is."""
    ranked, count = np.sort(np.where(seen, x, np.inf), axis=0), seen.sum(axis=0)
    low, high = (np.take_along_axis(ranked, at[None], axis=0)[0] for at in (np.maximum(count - 1, 0) // 2, count // 2))
    return np.where(count > 0, 0.5 * (low + high), 0.0)


def _statistics(
    left: np.ndarray, x: np.ndarray, units: Units, settings: ContrastSettings
) -> tuple[np.ndarray, np.ndarray, RunScatter]:
    """z (N,), the statistic of the regression's residuals with the actual labels; lots (L, N), the same under L
    divisions; and by how much runs scatter more than their stretches explain."""
    at = np.unique(units.run, return_inverse=True)[1]
    runs = int(at.max()) + 1
    # the last hypothesis, on the size of the residuals, is of another kind
    parts = [run_scatter(part, at, units.later, x.shape[1]) for part in (left[:, :-1], left[:, -1:])]
    scatter = RunScatter(*(np.concatenate([getattr(p, k) for p in parts]) for k in ("ratio", "freedom")))
    later = np.zeros(runs, dtype=bool)
    later[at] = units.later
    if _many(runs, units, settings):
        summed = np.zeros((runs, left.shape[1]))
        np.add.at(summed, at, left)
        z, lots = _against_lots(summed, averaged(x, at, runs), later, settings)
        return z, lots, scatter
    z, lots = _against_lots(left, x, units.later, settings)
    return with_few_runs(z, scatter, units.count - 1 - x.shape[1], units.count), lots, scatter


def _against_lots(
    left: np.ndarray, x: np.ndarray, later: np.ndarray, settings: ContrastSettings
) -> tuple[np.ndarray, np.ndarray]:
    """The statistic of each division is what it would be had that division been the actual one, so that the test is
    nearly exact if the runs are divided, and were divided at random (Draper and Stoneman 1966)."""
    divisions = np.concatenate([later[None, :], _other_divisions(later, settings.lots)])
    z = standardised(left, x, divisions)
    return z[0], z[1:]


def standardised(left: np.ndarray, x: np.ndarray, later: np.ndarray) -> np.ndarray:
    """(L, N) the sums of residuals left (U, N) over the later set of each division (L, U) bool, beside the conditions
    x (U, k), in standard deviations."""
    left = left - left.mean(axis=0)
    size = np.sqrt(np.sum(left**2, axis=0) / max(len(left) - 1, 1)) + TINY
    label = _unforeseen(later, x)
    return np.asarray(label @ left / (np.sqrt(np.sum(label**2, axis=1, keepdims=True)) * size + TINY))


def every_division(n: int, k: int) -> np.ndarray:
    """(L, n) bool: all divisions of n things into k later ones and the others."""
    out = np.zeros((comb(n, k), n), dtype=bool)
    for i, chosen in enumerate(combinations(range(n), k)):
        out[i, list(chosen)] = True
    return out


def _other_divisions(later: np.ndarray, most: int) -> np.ndarray:
    """(L, n) bool: other divisions of the units into two sets of these sizes, all of them if there are few."""
    n, k = len(later), int(later.sum())
    if comb(n, k) > most:
        return np.random.default_rng(most).permuted(np.tile(later, (most, 1)), axis=1)
    out = every_division(n, k)
    return out[(out != later).any(axis=1)]


def _share_beyond(lots: np.ndarray, a: float) -> float:
    """Share of the statistics of the other divisions (L,) that are at least a, the actual one included."""
    return (1.0 + np.count_nonzero(lots >= a * (1.0 - 1e-9))) / (1.0 + len(lots))


def _student_p(z: np.ndarray, freedom: int, count: int) -> np.ndarray:
    """(N,) Student's p of each hypothesis by itself, for too few units to permute."""
    if freedom < 1:
        return np.ones(len(z))
    return np.asarray(2.0 * stdtr(freedom, -np.abs(_student_of(z, freedom, count))))


def _normal_of(z: np.ndarray, freedom: int, count: int) -> np.ndarray:
    """A statistic of `count` observations, which is bounded, as the normal variable with the same tail."""
    if freedom < 1:
        return z
    tail = np.maximum(stdtr(freedom, -np.abs(_student_of(z, freedom, count))), TINY)
    return np.asarray(-np.sign(z) * ndtri(tail))


def _visible(
    left: np.ndarray,
    slope: np.ndarray,
    largest: np.ndarray,
    scatter: RunScatter,
    x: np.ndarray,
    units: Units,
    settings: ContrastSettings,
) -> np.ndarray:
    """(N,) the minimum detectable dose, with a power of at least 80 %."""
    if not len(largest):
        return np.full(left.shape[1], np.inf)
    runs, known = len(np.unique(units.run)), 1 + x.shape[1]
    freedom, by_run = units.count - known, runs - known
    many = _many(runs, units, settings)
    # a change also increases the residuals of the regression, so the statistic itself grows less than Student's
    beyond = np.quantile(largest, [1.0 - settings.level * (1.0 - settings.of_size)])
    threshold = _student_of(beyond, max(by_run if many else freedom, 1), runs if many else units.count)
    if not many and freedom > 0:
        tail = -stdtrit(scatter.freedom, stdtr(freedom, -threshold))
        threshold = np.where(scatter.freedom < freedom, tail, threshold)
    label = _unforeseen(units.later, x)
    spread = np.sqrt(np.sum(label**2) * np.var(left, axis=0)) * np.sqrt(scatter.ratio)
    return np.asarray((threshold + POWER) * spread / np.maximum(np.sum(label[:, None] ** 2 * slope, axis=0), TINY))


def _many(runs: int, units: Units, settings: ContrastSettings) -> bool:
    """Whether there are enough runs to divide anew. With many hypotheses and few runs, some hypothesis fits nearly
    every division by chance."""
    return comb(runs, len(np.unique(units.run[units.later]))) >= settings.labellings


def with_few_runs(z: np.ndarray, scatter: RunScatter, stretches: int, count: int) -> np.ndarray:
    """The statistic of `count` stretches if there are too few runs to divide: reduced where runs scatter by more than
    their stretches explain, and adjusted to the tails of Student's distribution with so few degrees of freedom.
    stretches: degrees of freedom of the variance of the stretches."""
    if stretches < 1:
        return z
    t = np.abs(_student_of(z, stretches, count)) / np.sqrt(scatter.ratio)
    t = -stdtrit(stretches, np.maximum(stdtr(scatter.freedom, -t), TINY))
    lower = np.sqrt((count - 1) / (stretches + t**2)) * t
    return np.asarray(np.where(scatter.freedom < stretches, np.sign(z) * lower, z))


def _student_of(z: np.ndarray, freedom: int, count: int) -> np.ndarray:
    """Student's t from a statistic of `count` observations, a correlation times the square root of count - 1."""
    share = np.minimum(z**2 / (count - 1), 1.0 - 1e-9)
    return np.asarray(np.sign(z) * np.sqrt(freedom * share / (1.0 - share)))
