"""The dense quadratic program of a condensed MPC, and the solvers that one may choose from.

min 1/2 z'Hz + g'z with low <= z <= high and row_low <= A z <= row_high. What lies outside +-ENDLESS is no bound.
"""

from dataclasses import dataclass
from typing import Any, Literal, Protocol

import numpy as np

from controllers.settings import Solver
from residual_mpc.extras import extra

ENDLESS = 1e20
Status = Literal["solved", "inaccurate", "failed"]


@dataclass(frozen=True, eq=False)
class Qp:
    """H (n, n) positive definite, g (n,), low and high (n,), A (m, n), row_low and row_high (m,)."""

    H: np.ndarray
    g: np.ndarray
    low: np.ndarray
    high: np.ndarray
    A: np.ndarray
    row_low: np.ndarray
    row_high: np.ndarray

    def cost(self, z: np.ndarray) -> float:
        """1/2 z'Hz + g'z."""
        return float(0.5 * z @ (self.H @ z) + self.g @ z)


class QpSolver(Protocol):
    """A leaf that owns its engine. `pattern` (m, n) bool, given at construction, says where A may be other than 0."""

    def solve(self, qp: Qp) -> tuple[np.ndarray, Status]:
        """z (n,) and how far to trust it; never raises for a program that has no solution."""
        ...


class Osqp:
    """OSQP: first order, its time grows little with the number of active limits. Warm-started by the last solution."""

    def __init__(self, pattern: np.ndarray, budget: float) -> None:
        import scipy.sparse as sp

        with extra("mpc"):
            import osqp

        m, n = pattern.shape
        self._whole = np.vstack([np.eye(n, dtype=bool), pattern])
        self._rows, self._triangle = np.zeros((n + m, n)), np.tril_indices(n)
        self._rows[:n] = np.eye(n)
        a = sp.csc_matrix(self._whole.astype(float))
        h = sp.csc_matrix(np.triu(np.ones((n, n))))
        h.data[:] = np.eye(n)[self._triangle]
        free = np.full(n + m, ENDLESS)
        self._engine = osqp.OSQP()
        # fixed intervals instead of clock time wherever OSQP asks: the same input has to give the same command
        self._engine.setup(
            h, np.zeros(n), a, -free, free, verbose=False, eps_abs=1e-4, eps_rel=1e-4, max_iter=500,
            adaptive_rho_interval=50, polishing=False, warm_starting=True, **_time_limit(budget),
        )  # fmt: skip
        self._n = n

    def solve(self, qp: Qp) -> tuple[np.ndarray, Status]:
        n = self._n
        self._rows[n:] = qp.A
        self._engine.update(
            Px=qp.H[self._triangle],  # row-major lower triangle = column-major upper one
            Ax=self._rows.T[self._whole.T],
            q=qp.g,
            l=np.concatenate([qp.low, qp.row_low]),
            u=np.concatenate([qp.high, qp.row_high]),
        )
        result = self._engine.solve(raise_error=False)
        status = result.info.status_val
        z = np.asarray(result.x, dtype=np.float64)
        if status == 1 and np.isfinite(z).all():  # OSQP_SOLVED
            return z, "solved"
        # 2 OSQP_SOLVED_INACCURATE, 7 OSQP_MAX_ITER_REACHED: an iterate that may still be worth more than no step
        usable = status in (2, 7) and np.isfinite(z).all()
        return (z, "inaccurate") if usable else (np.zeros(n), "failed")


class Daqp:
    """DAQP: dual active set, exact to rounding, and on programs of this size the faster one; steep soft limits, on
    which OSQP does not converge in time, cost it nothing.
    """

    def __init__(self, pattern: np.ndarray, budget: float) -> None:
        with extra("mpc"):
            import daqp

        self._solve: Any = daqp.solve
        self._sense = np.zeros(sum(pattern.shape), dtype=np.int32)
        self._limit = _time_limit(budget)

    def solve(self, qp: Qp) -> tuple[np.ndarray, Status]:
        low, high = np.concatenate([qp.low, qp.row_low]), np.concatenate([qp.high, qp.row_high])
        a = np.ascontiguousarray(qp.A)
        z, _, flag, _ = self._solve(qp.H.copy(), qp.g.copy(), a, high, low, self._sense.copy(), **self._limit)
        z = np.asarray(z, dtype=np.float64)
        return (z, "solved") if flag == 1 and np.isfinite(z).all() else (np.zeros(len(qp.g)), "failed")


def qp_solver(name: Solver, pattern: np.ndarray, budget: float) -> QpSolver:
    """The solver of that name."""
    return Osqp(pattern, budget) if name == "osqp" else Daqp(pattern, budget)


def _time_limit(budget: float) -> dict[str, float]:
    """The solvers' own clock is left out unless somebody asked for it."""
    return {"time_limit": budget} if np.isfinite(budget) else {}
