"""One linearly implicit step of joint velocities: stiff servos, dampers and dry friction at any length of the step.

M v' + c = T(q, v) - f is stepped as W (v+ - v) = h (T - c) - h^2 K v - h f with W = M + h D + h^2 K, where D and K are
what the torques lose by a joint's own velocity and position: the linearly implicit Euler method (Hairer and Wanner,
Solving ODEs II, 1996, section IV.7), as MuJoCo's `implicitfast` in D, and implicit in K besides, so that a stiff servo
is stable at any h. Dry friction f keeps |f_i| <= F_i, and f_i = F_i sgn(v+_i) where a joint moves; it is found by
sweeps over the joints, from the friction of the step before.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

SWEEPS = 3  # over the joints; W is nearly diagonal where servos or rotors are stiff


@dataclass(frozen=True, eq=False)
class Torques:
    """By joint, CasADi scalars: T N m, D N m s/rad and K N m/rad as above, and the level F of dry friction, N m (None
    where there is none).
    """

    torque: Sequence[Any]
    damping: Sequence[Any]
    stiffness: Sequence[Any]
    dry: Sequence[Any] | None


@dataclass(frozen=True, eq=False)
class Program:
    """W v+ + h f = wanted, f the dry friction; factors: of W."""

    w: Sequence[Sequence[Any]]
    factors: tuple[list[list[Any]], list[Any]]
    push: Sequence[Any]  # h (T - c) - h^2 K v

    def changes(self, held: Sequence[Any], h: float) -> list[Any]:
        """(n,) of the velocities, under friction `held`, N m."""
        return solved(self.factors, [r - h * f for r, f in zip(self.push, held, strict=True)])


def program(mass: Sequence[Sequence[Any]], bias: Sequence[Any], t: Torques, v: Sequence[Any], h: float) -> Program:
    """Of a step of h s from velocities v (n,): mass (n, n) and bias (n,) of M v' + c."""
    w = [list(row) for row in mass]
    push = []
    for i, speed in enumerate(v):
        w[i][i] = mass[i][i] + h * t.damping[i] + h * h * t.stiffness[i]
        push.append(h * (t.torque[i] - bias[i]) - h * h * t.stiffness[i] * speed)
    return Program(w, factorised(w), push)


def velocities(
    at: Program, dry: Sequence[Any] | None, v: Sequence[Any], held: Sequence[Any], h: float, clip: Any
) -> tuple[list[Any], list[Any]]:
    """v+ (n,) and the dry friction (n,) N m of a step of h s.

    dry: the level F; held (n,): the friction of the step before. clip(x, bound): x held within +-bound.
    """
    n, w = len(v), at.w
    friction = list(held)
    new = [speed + change for speed, change in zip(v, at.changes(friction, h), strict=True)]
    if dry is None:
        return new, friction
    wanted = [at.push[i] + sum(w[i][j] * v[j] for j in range(n)) for i in range(n)]
    for _ in range(SWEEPS):
        for i in range(n):
            rest = wanted[i] - sum(w[i][j] * new[j] for j in range(n) if j != i)
            friction[i] = clip(rest / h, dry[i])
            new[i] = (rest - h * friction[i]) / w[i][i]
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
