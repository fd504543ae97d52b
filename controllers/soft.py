"""Soft limits of a quadratic program: rows and a slack for each, added only if the solution violates one."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from controllers.qp import ENDLESS, Qp
from controllers.settings import Soft

WITHIN = 1e-9  # of a limit's unit


@dataclass(frozen=True, eq=False)
class SoftRows:
    """values: (N,) each limited quantity along the plan; slopes: (N, m) its derivative with respect to the plan."""

    limits: Sequence[Soft]
    values: Sequence[np.ndarray]
    slopes: Sequence[np.ndarray]

    def kept(self, z: np.ndarray) -> bool:
        """Whether the change z (m,) of the plan violates no limit. It then also solves the program with the limits."""
        for limit, value, slope in zip(self.limits, self.values, self.slopes, strict=True):
            there = value + slope @ z
            if there.min() < limit.lower - WITHIN or there.max() > limit.upper + WITHIN:
                return False
        return True


def softened(qp: Qp, soft: SoftRows) -> Qp:
    """The program with the limits, z = (change of the plan (m,), one slack per limit)."""
    m, n, extra = len(qp.g), len(soft.values[0]), len(soft.limits)
    H = np.block([[qp.H, np.zeros((m, extra))], [np.zeros((extra, m)), np.eye(extra)]])
    price = np.array([limit.price * limit.square**-0.5 for limit in soft.limits])
    low, high = np.concatenate([qp.low, np.zeros(extra)]), np.concatenate([qp.high, np.full(extra, ENDLESS)])
    rows, lows, highs = [np.hstack([qp.A, np.zeros((len(qp.A), extra))])], [qp.row_low], [qp.row_high]
    for j, (limit, value, slope) in enumerate(zip(soft.limits, soft.values, soft.slopes, strict=True)):
        slack = np.zeros((n, extra))
        slack[:, j] = limit.square**-0.5  # a slack in units that cost one: first-order solvers need it
        rows += [np.hstack([slope, slack]), np.hstack([-slope, slack])]
        lows += [limit.lower - value, value - limit.upper]
        highs += [np.full(n, ENDLESS)] * 2
    g = np.concatenate([qp.g, price])
    return Qp(H, g, low, high, np.vstack(rows), np.concatenate(lows), np.concatenate(highs))
