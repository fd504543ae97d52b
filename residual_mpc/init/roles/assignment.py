"""Every column given to one role at most, and the rivals of each choice named."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from math import exp, inf

import numpy as np
from scipy.optimize import linear_sum_assignment

from residual_mpc.init.columns.guess import Guess
from residual_mpc.init.columns.words import ColumnName

ENOUGH = 2.0  # log odds from which a column is taken
CLOSE = 1.0  # log odds within which another column is as plausible
NEVER = -inf

Odds = tuple[float, tuple[str, ...]]  # log odds that a column has a role, and the reasons
Rule = Callable[[ColumnName], Odds]


def assign(rules: Mapping[str, Rule], free: Iterable[ColumnName]) -> tuple[Guess, ...]:
    """The choice of columns, among those that are free, whose log odds sum to the most; roles may stay empty."""
    words = tuple(free)
    if not rules or not words:
        return ()
    found = {role: [rule(w) for w in words] for role, rule in rules.items()}
    odds = np.array([[max(o, -50.0) for o, _ in row] for row in found.values()])  # (roles, columns)
    gain = np.maximum(odds - ENOUGH, 0.0)  # to leave a role empty costs nothing
    guesses = []
    for i, k in zip(*linear_sum_assignment(gain, maximize=True), strict=True):
        if odds[i, k] < ENOUGH:
            continue
        role = list(rules)[i]
        rivals = _rivals(odds, i, k)
        reasons = ", ".join(r for r in found[role][k][1] if r)
        sure = _share(odds[i, k] - ENOUGH + 0.5)
        if rivals:
            sure = min(sure, _share(float(odds[i, k] - odds[i, rivals].max())))
        others = tuple(words[r].name for r in rivals)
        guesses.append(Guess(role, words[k].name, reasons or "the only column that fits", round(sure, 2), others))
    return tuple(guesses)


def _share(odds: float) -> float:
    """The probability of log odds, never quite 1."""
    return 1.0 / (1.0 + exp(-min(odds, 5.0)))


def _rivals(odds: np.ndarray, i: int, k: int) -> list[int]:
    """Columns that fit role i about as well as column k, and no other role clearly better."""
    near = np.flatnonzero(odds[i] > max(ENOUGH, odds[i, k] - CLOSE))
    others = np.delete(odds, i, axis=0)
    return [int(r) for r in near if r != k and (not len(others) or others[:, r].max() < odds[i, r] + CLOSE)]
