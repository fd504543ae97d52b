"""Exact test over all divisions of a few runs: whether a single change explains more between the two sets than between
any other two sets of the same runs.

The statistic of a division is the largest predicted drop of the cost by one change. If nothing changed, the runs could
have been divided in any way, so the rank of the actual division among all divisions is an exact p (Fisher 1935, section
21), whatever the residuals' distribution, and the largest of all changes needs no correction for their number. The
contrasts, which are standardised, see small changes beside larger, steady errors; this test sees changes that explain
much, even where the runs differ by more than a few of them can tell.
"""

from itertools import combinations
from math import comb

import numpy as np

from residual_mpc.comparison.settings import ContrastSettings
from residual_mpc.comparison.units import Units

FAINT = 1e-6  # of a direction's size in all runs: below it, a set tells nothing of it
TINY = 1e-300
SAME = 1e-9  # relative difference below which two divisions tie


def p_of_divisions(
    size: np.ndarray, score: np.ndarray, misfit: np.ndarray, units: Units, settings: ContrastSettings
) -> float | None:
    """The share of the divisions of the runs into sets of the same sizes in which a change explains at least as much;
    None where there are too few divisions for a small share, or so many that the contrasts divide the runs themselves.

    size, score (U, N): for each unit and change, the products of a direction with itself and with the residuals; misfit
    (U, N): mean square of the residuals that the unit's own estimate leaves.
    """
    at = np.unique(units.run, return_inverse=True)[1]
    runs = int(at.max()) + 1
    later = np.zeros(runs, dtype=bool)
    later[at] = units.later
    count = comb(runs, int(later.sum()))
    alike = 2 if 2 * int(later.sum()) == runs else 1  # two sets that are swapped are the same division
    if alike / count > settings.of_runs or count >= settings.labellings:
        return None
    least = np.maximum(misfit, 1e-9 * misfit.max(axis=0, initial=0.0) + 1e-30)
    sizes, scores = np.zeros((runs, size.shape[1])), np.zeros((runs, size.shape[1]))
    np.add.at(sizes, at, size / least)
    np.add.at(scores, at, score / least)
    divisions = every_division(runs, int(later.sum()))
    drops = _drops(divisions.astype(float), sizes, scores).max(axis=1, initial=0.0)
    own = float(_drops(later[None].astype(float), sizes, scores).max(initial=0.0))
    return float(np.mean(drops >= own * (1.0 - SAME))) if own > 0.0 else 1.0


def every_division(n: int, k: int) -> np.ndarray:
    """(L, n) bool: all divisions of n things into k later ones and the others."""
    out = np.zeros((comb(n, k), n), dtype=bool)
    for i, chosen in enumerate(combinations(range(n), k)):
        out[i, list(chosen)] = True
    return out


def combined(one: np.ndarray, other: float | None) -> np.ndarray:
    """p of two independent tests together, from that of each (Fisher 1932, section 21.1): that the product of two
    uniform variables is as small. other: None where there is one test."""
    if other is None:
        return one
    both = np.maximum(one * other, TINY)
    return np.asarray(both * (1.0 - np.log(both)))


def _drops(later: np.ndarray, size: np.ndarray, score: np.ndarray) -> np.ndarray:
    """(L, N) drop of the cost by each of N directions, of different size in the two sets, for L divisions; later
    (L, R): 1 for the runs of the later set; size, score (R, N): products of a direction with itself and with the
    residuals."""
    whole = size.sum(axis=0)
    one, told = later @ size, later @ score
    other, rest = whole - one, score.sum(axis=0) - told
    seen = np.minimum(one, other) > FAINT * whole
    one, other = np.where(seen, one, 1.0), np.where(seen, other, 1.0)
    dose = told / one - rest / other
    return np.asarray(np.where(seen, dose**2 * one * other / (one + other), 0.0))
