"""Exact tests over the divisions of a few runs into two sets: whether the actual sets differ by more than any other two
sets of the same runs.

If nothing changed, the runs could have been divided in any way, so the rank of a statistic of the actual division among
those of all divisions is an exact p (Fisher 1935, section 21), whatever the residuals' distribution. The largest
statistic of all changes is ranked, so that their number needs no correction (Westfall and Young 1993, algorithm 2.8).

Two statistics see different changes. The predicted drop of the cost by one change sees what explains much, even where
the runs differ by more than a few of them can tell; its p is combined with that of the stretches. The standardised
difference of the sets (see `permutation`) sees a small change beside larger, steady errors: in each division the runs
themselves say by how much they scatter, which the test of the stretches has to guess from all changes together.
"""

from dataclasses import dataclass
from math import comb

import numpy as np

from residual_mpc.comparison.permutation import Differences, every_division, standardised, with_few_runs
from residual_mpc.comparison.run_scatter import run_scatter
from residual_mpc.comparison.settings import ContrastSettings
from residual_mpc.comparison.units import Units

FAINT = 1e-6  # of a direction's size in all runs: below it, a set tells nothing of it
TINY = 1e-300
SAME = 1e-9  # relative difference below which two divisions tie


@dataclass(frozen=True, eq=False)
class RunDivisions:
    """at (U,): the run of each unit; later (R,) bool: the runs of the later set; smallest: p of a division that is more
    extreme than all others."""

    at: np.ndarray
    later: np.ndarray
    smallest: float

    @property
    def count(self) -> int:
        """Of all divisions into sets of these sizes."""
        return comb(len(self.later), int(self.later.sum()))

    def every(self) -> np.ndarray:
        """(L, R) bool"""
        return every_division(len(self.later), int(self.later.sum()))

    def drawn(self, most: int) -> np.ndarray:
        """(L, R) bool: the actual division first, and others, at most so many in all."""
        others = self.every()
        others = others[(others != self.later).any(axis=1)]
        if len(others) >= most:
            others = others[np.random.default_rng(most).choice(len(others), most - 1, replace=False)]
        return np.concatenate([self.later[None], others])


def run_divisions(units: Units) -> RunDivisions:
    """The divisions of the runs of these units."""
    at = np.unique(units.run, return_inverse=True)[1]
    later = np.zeros(int(at.max()) + 1, dtype=bool)
    later[at] = units.later
    alike = 2 if 2 * int(later.sum()) == len(later) else 1  # two sets that are swapped are the same division
    return RunDivisions(at, later, alike / comb(len(later), int(later.sum())))


def p_of_divisions(
    size: np.ndarray, score: np.ndarray, misfit: np.ndarray, units: Units, settings: ContrastSettings
) -> float | None:
    """The share of the divisions of the runs into sets of the same sizes in which a change explains at least as much;
    None where there are too few divisions for a small share, or so many that the contrasts divide the runs themselves.

    size, score (U, N): for each unit and change, the products of a direction with itself and with the residuals; misfit
    (U, N): mean square of the residuals that the unit's own estimate leaves.
    """
    runs = run_divisions(units)
    if runs.smallest > settings.of_runs or runs.count >= settings.labellings:
        return None
    drops = _drops_of(runs, runs.every(), size, score, misfit).max(axis=1, initial=0.0)
    own = float(_drops_of(runs, runs.later[None], size, score, misfit).max(initial=0.0))
    return float(np.mean(drops >= own * (1.0 - SAME))) if own > 0.0 else 1.0


def p_of_runs(found: Differences, units: Units, settings: ContrastSettings) -> np.ndarray | None:
    """(N,) the share of the divisions in which the largest standardised difference is at least that of each change;
    None where there are too few divisions, or so many that the contrasts divide the runs themselves. found: of these N
    changes, and of the size of the residuals last."""
    runs = run_divisions(units)
    if runs.smallest > settings.of_differences or runs.count >= settings.labellings:
        return None
    z = np.abs(_standardised(found, runs, runs.drawn(settings.run_lots)))
    ranked = np.sort(z.max(axis=1, initial=0.0))
    return 1.0 - np.searchsorted(ranked, z[0] * (1.0 - SAME), side="left") / len(ranked)


def _standardised(found: Differences, runs: RunDivisions, divisions: np.ndarray) -> np.ndarray:
    """(L, N) the standardised differences of all changes for L divisions of the runs."""
    left, x, labels = found.left[:, :-1], found.conditions, divisions[:, runs.at]
    z = standardised(left, x, labels)
    freedom = len(left) - 1 - x.shape[1]
    scatters = (run_scatter(left, runs.at, later, x.shape[1]) for later in labels)
    return np.array([with_few_runs(a, s, freedom, len(left)) for a, s in zip(z, scatters, strict=True)])


def combined(one: np.ndarray, other: float | None) -> np.ndarray:
    """p of two independent tests together, from that of each (Fisher 1932, section 21.1): that the product of two
    uniform variables is as small. other: None where there is one test."""
    if other is None:
        return one
    both = np.maximum(one * other, TINY)
    return np.asarray(both * (1.0 - np.log(both)))


def _drops_of(
    runs: RunDivisions, divisions: np.ndarray, size: np.ndarray, score: np.ndarray, misfit: np.ndarray
) -> np.ndarray:
    """(L, N) drop of the cost by each of N changes for divisions (L, R) bool."""
    least = np.maximum(misfit, 1e-9 * misfit.max(axis=0, initial=0.0) + 1e-30)
    sizes, scores = np.zeros((len(runs.later), size.shape[1])), np.zeros((len(runs.later), size.shape[1]))
    np.add.at(sizes, runs.at, size / least)
    np.add.at(scores, runs.at, score / least)
    return _drops(divisions.astype(float), sizes, scores)


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
