"""Dry friction and joint limits as MuJoCo has them: the acceleration that its Newton solver converges to.

The acceleration minimises (a - a0)^T M (a - a0) / 2 plus a piecewise quadratic cost of each joint's own acceleration
(MuJoCo documentation, Computation, "Primal problem"). Newton's method on the pieces is exact once the pieces are right.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from plants.mujoco_robot.native.lanes import Condition, Lanes, Number, compared, dot, lanes, load, size_of, store, where
from plants.mujoco_robot.native.program import VECTOR, Program

MOST = 24  # iterations; rows that need more go back to MuJoCo
ROUNDING = 1e-12  # relative, of accelerations
SEARCHED = 60  # iterations of a line search, most of them halvings of a bracket


@dataclass(frozen=True, eq=False)
class Friction:
    """most: N m; stiff: 1/R; aim: the acceleration at which it is 0."""

    most: Lanes
    stiff: Lanes
    aim: Number


@dataclass(frozen=True, eq=False)
class Limit:
    """side: 1 of a lower limit, -1 of an upper one; near: condition, the limit is within its margin; stiff: 1/R; aim:
    of the acceleration away from the limit."""

    side: float
    near: Condition
    stiff: Number
    aim: Number


@dataclass(frozen=True, eq=False)
class Tie:
    """What always holds a length at its place. stiff: 1/R; aim: of the acceleration."""

    stiff: Number
    aim: Number


@dataclass(frozen=True, eq=False)
class Constraint:
    """What restrains a length, the sum of joint positions times `of`: dry friction, limits, or both; or a tie."""

    of: Mapping[int, float]
    friction: Friction | None
    limits: Sequence[Limit]
    tie: Tie | None = None

    def length(self, x: Sequence[Number]) -> Number:
        """The length's share of joint positions, or of their rates."""
        return dot([x[i] for i in self.of], list(self.of.values()))


Mass = Mapping[tuple[int, int], Number]
Pieces = list[tuple[Number, Number]]


def pieces(p: Program, constraints: Sequence[Constraint], a: Sequence[Number]) -> Pieces:
    """Of every constraint, at these accelerations: d, f of its force f - d a on the piece where they lie."""
    out: Pieces = []
    for constraint in constraints:
        x = constraint.length(a)
        stiff: Number = 0.0
        force: Number = 0.0
        rubs = constraint.friction
        if rubs is not None:
            off = x - rubs.aim
            reach = rubs.most / rubs.stiff
            sticks = (off < reach) & (off > -reach)
            slips = where(p, compared(p, "olt", off, 0.0), rubs.most, -rubs.most)
            stiff = stiff + where(p, sticks, rubs.stiff, 0.0)
            force = force + where(p, sticks, rubs.stiff * rubs.aim, slips)
        for limit in constraint.limits:
            pushed = limit.near & compared(p, "olt", x * limit.side, limit.aim)
            stiff = stiff + where(p, pushed, limit.stiff, 0.0)
            force = force + where(p, pushed, limit.stiff * limit.aim * limit.side, 0.0)
        if constraint.tie is not None:
            stiff = stiff + constraint.tie.stiff
            force = force + constraint.tie.stiff * constraint.tie.aim
        out.append((stiff, force))
    return out


def restrained(
    mass: Mass, torque: Sequence[Number], constraints: Sequence[Constraint], here: Pieces
) -> tuple[Mass, list[Number]]:
    """The equation of motion on these pieces: M + J^T d J, and torques with J^T f."""
    m, t = dict(mass), list(torque)
    for constraint, (stiff, force) in zip(constraints, here, strict=True):
        for i, x in constraint.of.items():
            t[i] = t[i] + force * x
            for j, y in constraint.of.items():
                if j <= i:  # joints of two branches have no inertia in common
                    m[i, j] = m.get((i, j), 0.0) + stiff * (x * y)
    return m, t


def forces(constraints: Sequence[Constraint], here: Pieces, a: Sequence[Number]) -> list[Number]:
    """The constraints' torques at the joints."""
    out: list[Number] = [0.0] * len(a)
    for constraint, (stiff, force) in zip(constraints, here, strict=True):
        now = force - stiff * constraint.length(a)
        for i, x in constraint.of.items():
            out[i] = out[i] + now * x
    return out


def least_on_the_way(
    p: Program,
    mass: Mass,
    torque: Sequence[Number],
    constraints: Sequence[Constraint],
    a: Sequence[Number],
    b: Sequence[Number],
) -> list[Number]:
    """The accelerations of the least cost between a and b, where Newton's method leads: its whole steps can cycle. The
    cost's slope along the way is piecewise linear and rises; its root is bracketed, and halved or found by a line."""
    way = [y - x for x, y in zip(a, b, strict=True)]
    mapped = _times(mass, way)
    square, begin = dot(way, mapped), dot(mapped, a) - dot(way, torque)
    along = [c.length(way) for c in constraints]
    bracket, rounds = p.memory(VECTOR, 3), p.memory("i64", 1)  # its ends, and where the slope is looked at next
    for k, x in enumerate((0.0, 1.0, 1.0)):
        store(p, x, bracket, k)
    p.store("i64", "0", rounds)
    search, found = p.label("search"), p.label("found")
    p.jump(search)
    p.begin(search)
    low, high, t = (load(p, bracket, k) for k in range(3))
    there = [x + d * t for x, d in zip(a, way, strict=True)]
    slope: Number = begin + square * t
    rise = square
    for c, d, (stiff, force) in zip(constraints, along, pieces(p, constraints, there), strict=True):
        slope = slope - d * (force - stiff * c.length(there))
        rise = rise + d * d * stiff
    beyond = compared(p, "ogt", slope, 0.0)
    low, high = where(p, beyond, low, t), where(p, beyond, t, high)
    guess = lanes(p, t - slope / rise)
    inside = (guess > low) & (guess < high)
    new = where(p, inside, guess, 0.5 * (low + high))
    for k, end in enumerate((low, high, new)):
        store(p, end, bracket, k)
    number = p.pure(f"add i64 {p.load('i64', rounds)}, 1")
    p.store("i64", number, rounds)
    apart = compared(p, "ogt", size_of(p, new - t), ROUNDING).anywhere()
    p.branch(p.pure(f"and i1 {apart}, {p.pure(f'icmp slt i64 {number}, {SEARCHED}')}"), search, found)
    p.begin(found)
    least = load(p, bracket, 2)
    return [x + d * least for x, d in zip(a, way, strict=True)]


def _times(mass: Mass, x: Sequence[Number]) -> list[Number]:
    """M x."""
    out: list[Number] = [0.0] * len(x)
    for (i, j), m in mass.items():
        out[i] = out[i] + m * x[j]
        if i != j:
            out[j] = out[j] + m * x[i]
    return out


def solve(mass: Mass, b: Sequence[Number]) -> list[Number]:
    """x of M x = b, by M = L^T D L, which keeps the zeros of a branched chain (Featherstone 2008, section 6.5); a tie
    of two branches fills some of them."""
    n, m = len(b), dict(mass)
    inverse: list[Number] = [0.0] * n
    for k in range(n - 1, -1, -1):
        inverse[k] = 1.0 / m[k, k]
        before = [i for i in range(k) if (k, i) in m]
        for i in reversed(before):
            scaled = m[k, i] * inverse[k]
            for j in before:
                if j <= i:
                    m[i, j] = m.get((i, j), 0.0) - scaled * m[k, j]
            m[k, i] = scaled
    x = list(b)
    for k in range(n - 1, -1, -1):
        for i in range(k):
            if (k, i) in m:
                x[i] = x[i] - m[k, i] * x[k]
    x = [a * d for a, d in zip(x, inverse, strict=True)]
    for k in range(n):
        for i in range(k):
            if (k, i) in m:
                x[k] = x[k] - m[k, i] * x[i]
    return x
