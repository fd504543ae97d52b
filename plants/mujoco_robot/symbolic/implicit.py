"""One linearly implicit step of the joint velocities, stable for stiff servos, dampers and dry friction at any length.

M v' + c = T(q, v) - f is integrated as W (v+ - v) = h (T - c) - h^2 K v - h f with W = M + h D + h^2 K, where D_i =
-dT_i/dv_i and K_i = -dT_i/dq_i: the linearly implicit Euler method (Hairer and Wanner, Solving ODEs II, 1996, section
IV.7). MuJoCo's `implicitfast` is implicit in D only; the term in K keeps a stiff servo stable at any h. Dry friction
satisfies |f_i| <= F_i, and f_i = F_i sgn(v+_i) for a moving joint. Projected Gauss-Seidel sweeps over the joints find
it from the responses W^-1 to unit impulses, starting from the friction that would hold every joint (Stewart and Trinkle
1996 state the complementarity problem). A moving joint then has the right friction after one sweep, however strongly
the links couple the joints, whereas sweeps on W itself converge slowly.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

SWEEPS = 5  # over the joints; more than one is needed only where friction holds some joints while others move


@dataclass(frozen=True, eq=False)
class Torques:
    """CasADi scalars by joint: T (N m), D (N m s/rad) and K (N m/rad) as above, and the level F of dry friction (N m),
    None without friction.
    """

    torque: Sequence[Any]
    damping: Sequence[Any]
    stiffness: Sequence[Any]
    dry: Sequence[Any] | None


@dataclass(frozen=True, eq=False)
class LinearStep:
    """The linear system of a step. w: W; factors: those of W."""

    w: Sequence[Sequence[Any]]
    factors: tuple[list[list[Any]], list[Any]]
    push: Sequence[Any]  # h (T - c) - h^2 K v

    def changes(self, held: Sequence[Any], h: float) -> list[Any]:
        """(n,) change of the velocities in a step of h s under the friction `held` (n,) N m."""
        return solved(self.factors, [r - h * f for r, f in zip(self.push, held, strict=True)])

    def responses(self) -> list[list[Any]]:
        """(n, n) W^-1, by joint: the change of the velocities under a unit impulse at that joint."""
        n = len(self.push)
        return [solved(self.factors, [1.0 if j == i else 0.0 for j in range(n)]) for i in range(n)]


def linear_step(
    mass: Sequence[Sequence[Any]], bias: Sequence[Any], t: Torques, v: Sequence[Any], h: float
) -> LinearStep:
    """The linear system of a step of h s from velocities v (n,), with mass M (n, n) and bias c (n,)."""
    w = [list(row) for row in mass]
    push = []
    for i, speed in enumerate(v):
        w[i][i] = mass[i][i] + h * t.damping[i] + h * h * t.stiffness[i]
        push.append(h * (t.torque[i] - bias[i]) - h * h * t.stiffness[i] * speed)
    return LinearStep(w, factorised(w), push)


def velocities(
    at: LinearStep, dry: Sequence[Any] | None, v: Sequence[Any], h: float, clip: Any
) -> tuple[list[Any], list[Any]]:
    """v+ (n,) and the dry friction (n,) N m of a step of h s from the velocities v (n,).

    dry: the level F; clip(x, bound): x limited to +-bound.
    """
    n = len(v)
    if dry is None:
        return [speed + change for speed, change in zip(v, at.changes([0.0] * n, h), strict=True)], [0.0] * n
    impulse = [at.push[i] + sum(at.w[i][j] * v[j] for j in range(n)) for i in range(n)]
    friction = [clip(s / h, level) for s, level in zip(impulse, dry, strict=True)]
    new = solved(at.factors, [s - h * f for s, f in zip(impulse, friction, strict=True)])
    response = at.responses()
    for _ in range(SWEEPS):
        for i in range(n):
            before = friction[i]
            friction[i] = clip(before + new[i] / (h * response[i][i]), dry[i])
            change = h * (friction[i] - before)
            new = [speed - change * r for speed, r in zip(new, response[i], strict=True)]
    return new, friction


def factorised(w: Sequence[Sequence[Any]]) -> tuple[list[list[Any]], list[Any]]:
    """L (n, n) with ones on its diagonal and d (n,): w = L diag(d) L' of a positive definite w (Golub and Van Loan,
    Matrix Computations, 2013, algorithm 4.1.2).
    """
    n = len(w)
    lower: list[list[Any]] = [[0.0] * n for _ in range(n)]
    d: list[Any] = []
    for j in range(n):
        scaled = [lower[j][k] * d[k] for k in range(j)]
        d.append(w[j][j] - sum(lower[j][k] * scaled[k] for k in range(j)))
        for i in range(j + 1, n):
            lower[i][j] = (w[i][j] - sum(lower[i][k] * scaled[k] for k in range(j))) / d[j]
    return lower, d


def solved(factors: tuple[list[list[Any]], list[Any]], b: Sequence[Any]) -> list[Any]:
    """x (n,) with L diag(d) L' x = b (n,)."""
    lower, d = factors
    n = len(b)
    x = list(b)
    for i in range(n):
        x[i] = x[i] - sum(lower[i][k] * x[k] for k in range(i))
    x = [x[i] / d[i] for i in range(n)]
    for i in reversed(range(n)):
        x[i] = x[i] - sum(lower[k][i] * x[k] for k in range(i + 1, n))
    return x
