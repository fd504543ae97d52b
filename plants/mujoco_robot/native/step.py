"""Accelerations of a chain of hinges and slides as MuJoCo has them: forces, constraints, implicit damping.

The equations are those of MuJoCo's documentation (Computation) and of its source, engine_forward.c,
engine_core_constraint.c and engine_derivative.c.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from plants.mujoco_robot.native.constraints import (
    MOST,
    ROUNDING,
    Constraint,
    Friction,
    Limit,
    Mass,
    Pieces,
    forces,
    least_on_the_way,
    pieces,
    restrained,
    solve,
)  # fmt: skip
from plants.mujoco_robot.native.dynamics import Joint, LinkNumbers, inertia_and_bias
from plants.mujoco_robot.native.lanes import (
    Lanes,
    Number,
    compared,
    dot,
    larger,
    load,
    never,
    size_of,
    smaller,
    store,
    where,
)
from plants.mujoco_robot.native.program import VECTOR, Program, Value

Integrator = Literal["Euler", "implicitfast", "RK4"]


@dataclass(frozen=True)
class Actuator:
    """joint: that it drives; gear: torque there per unit of its force; clamp: range of its command, None without one;
    limited: whether its force has a range."""

    joint: int
    gear: float
    clamp: tuple[float, float] | None
    limited: bool


@dataclass(frozen=True)
class Stop:
    """How a joint's limits push back. margin: rad or m; solimp: of the impedance, clipped."""

    margin: float
    solimp: tuple[float, float, float, float, float]


@dataclass(frozen=True)
class Tendon:
    """A length, the sum of joint positions times the coefficients in `of`, with a spring that has a dead band; stop: of
    its limits, None without any."""

    of: tuple[tuple[int, float], ...]
    stop: Stop | None


@dataclass(frozen=True)
class Chain:
    """An arm as the program has it, the same for all rows and any time step. integrator: the damping of the joints is
    implicit in Euler, that of servos as well in implicitfast, and none in RK4; drawn: joint positions in the drawn
    posture; reach: of the torque of all of a joint's actuators. rubs: whether joints have dry friction; stops: of
    joints with limits."""

    integrator: Integrator
    drawn: tuple[float, ...]
    joints: tuple[Joint, ...]
    actuators: tuple[Actuator, ...]
    reach: tuple[tuple[float, float] | None, ...]
    rubs: bool
    stops: tuple[Stop | None, ...]
    tendons: tuple[Tendon, ...]


ARM = 4  # numbers of an arm: time step, gravity 3
LINK = 13  # of a link: place 3, mass, centre 3, inertia 6
# of a joint: armature, damping, stiffness, spring's rest, friction, its 1/R and B, lower and upper limit, their K and
# B, inverse weight, torque beside the actuators'
JOINT = 13
DAMPING, FRICTION, BESIDE = 1, 4, 12  # where among them are those that change between steps
ACTUATOR = 6  # of an actuator: gain, bias 3, range 2
# of a tendon: stiffness, ends of the dead band, lower and upper limit, their K and B, inverse weight, damping
TENDON = 9


def sizes(chain: Chain) -> int:
    """Numbers of a row."""
    return tendon_at(chain, len(chain.tendons))


def joint_at(chain: Chain, i: int) -> int:
    """Where a joint's numbers begin."""
    return ARM + LINK * len(chain.joints) + JOINT * i


def actuator_at(chain: Chain, i: int) -> int:
    """Where an actuator's numbers begin."""
    return joint_at(chain, len(chain.joints)) + ACTUATOR * i


def tendon_at(chain: Chain, i: int) -> int:
    """Where a tendon's numbers begin."""
    return actuator_at(chain, len(chain.actuators)) + TENDON * i


@dataclass(frozen=True, eq=False)
class Row:
    """The numbers of the rows, as they lie in memory."""

    p: Program
    array: Value
    chain: Chain

    @property
    def step(self) -> Lanes:
        return self._load(0)

    @property
    def gravity(self) -> tuple[Lanes, Lanes, Lanes]:
        return self._load(1), self._load(2), self._load(3)

    def link(self, i: int) -> LinkNumbers:
        at = ARM + LINK * i
        place, centre = ((self._load(at + k), self._load(at + k + 1), self._load(at + k + 2)) for k in (0, 4))
        return LinkNumbers(place, self._load(at + 3), centre, tuple(self._load(at + 7 + k) for k in range(6)))

    def joint(self, i: int) -> list[Lanes]:
        at = joint_at(self.chain, i)
        return [self._load(at + k) for k in range(JOINT)]

    def actuator(self, i: int) -> list[Lanes]:
        at = actuator_at(self.chain, i)
        return [self._load(at + k) for k in range(ACTUATOR)]

    def tendon(self, i: int) -> list[Lanes]:
        at = tendon_at(self.chain, i)
        return [self._load(at + k) for k in range(TENDON)]

    def _load(self, at: int) -> Lanes:
        return load(self.p, self.array, at)


def accelerations(
    p: Program, chain: Chain, row: Row, q: Sequence[Lanes], v: Sequence[Lanes], state: Value, controls: Value,
    outputs: Value, failed: Value,
) -> tuple[list[Number], list[Number]]:  # fmt: skip
    """Accelerations of a step, with what damping is implicit, and without it, from which the solver goes on."""
    n, h = len(chain.joints), row.step
    off = [x - x0 for x, x0 in zip(q, chain.drawn, strict=True)]
    links = [row.link(i) for i in range(n)]
    mass, bias = inertia_and_bias(p, chain.joints, links, row.gravity, off, v)
    joints = [row.joint(i) for i in range(n)]
    torque: list[Number] = [-b for b in bias]
    driven, damping = _actuated(p, chain, row, q, v, controls, outputs)
    for i, (armature, damp, stiff, rest, *_, beside) in enumerate(joints):
        mass[i, i] = mass[i, i] + armature
        torque[i] = torque[i] + driven[i] + beside - stiff * (q[i] - rest) - damp * v[i]
        of_joint = damp if chain.integrator != "RK4" else 0.0
        damping[i] = of_joint + (damping[i] if chain.integrator == "implicitfast" else 0.0)
    constraints = [
        Constraint(
            {i: 1.0},
            Friction(loss, k, -(b * v[i])) if chain.rubs else None,
            () if one is None else _limits(p, one, q[i], v[i], stop),
        )
        for i, (one, (_, _, _, _, loss, k, b, *stop, _)) in enumerate(zip(chain.stops, joints, strict=True))
    ]
    constraints = [c for c in constraints if c.friction is not None or c.limits]
    for t, tendon in enumerate(chain.tendons):
        stiff, from_, to, *stop, damp = row.tendon(t)
        length, rate = (dot([x[i] for i, _ in tendon.of], [c for _, c in tendon.of]) for x in (q, v))
        pull = stiff * (larger(p, from_ - length, 0.0) + smaller(p, to - length, 0.0)) - damp * rate
        for i, c in tendon.of:
            torque[i] = torque[i] + pull * c
        if tendon.stop is not None:
            constraints.append(Constraint(dict(tendon.of), None, _limits(p, tendon.stop, length, rate, stop)))
    free: list[Number] = list(torque)
    keep: list[Number] | None = None
    if constraints:
        keep, held = _constrained(p, mass, torque, constraints, state, failed)
        free = [t + f for t, f in zip(torque, held, strict=True)]
    implicit = {(i, j): m + damping[i] * h if i == j else m for (i, j), m in mass.items()}
    for t, tendon in enumerate(chain.tendons if chain.integrator == "implicitfast" else ()):
        slowed = row.tendon(t)[-1] * h
        for (i, c), (j, d) in itertools.product(tendon.of, tendon.of):
            if (i, j) in implicit:
                implicit[i, j] = implicit[i, j] + slowed * (c * d)
    a = solve(implicit, free)
    return a, a if keep is None else keep


def _actuated(
    p: Program, chain: Chain, row: Row, q: Sequence[Lanes], v: Sequence[Lanes], controls: Value, outputs: Value
) -> tuple[list[Number], list[Number]]:
    """Torques at the joints, and how they fall with the joints' velocities; an actuator at the end of its range has no
    damping, and neither have those of a joint at the end of its own."""
    n = len(chain.joints)
    torque: list[Number] = [0.0] * n
    damping: list[Number] = [0.0] * n
    for i, actuator in enumerate(chain.actuators):
        gain, b0, b1, b2, low, high = row.actuator(i)
        u = load(p, controls, i)
        if actuator.clamp is not None:
            u = smaller(p, larger(p, u, actuator.clamp[0]), actuator.clamp[1])
        j, gear = actuator.joint, actuator.gear
        force = gain * u + b0 + b1 * (q[j] * gear) + b2 * (v[j] * gear)
        slope: Number = b2
        if actuator.limited:
            inside = (force > low) & (force < high)
            slope = where(p, inside, b2, 0.0)
            force = smaller(p, larger(p, force, low), high)  # type: ignore[arg-type]
        store(p, force, outputs, i)
        torque[j] = torque[j] + gear * force
        damping[j] = damping[j] - gear * gear * slope
    for j, reach in enumerate(chain.reach):
        if reach is not None:
            inside = compared(p, "ogt", torque[j], reach[0]) & compared(p, "olt", torque[j], reach[1])
            damping[j] = where(p, inside, damping[j], 0.0)
            torque[j] = smaller(p, larger(p, torque[j], reach[0]), reach[1])
    return torque, damping


def _constrained(
    p: Program,
    mass: Mass,
    torque: Sequence[Number],
    constraints: Sequence[Constraint],
    state: Value,
    failed: Value,
) -> tuple[list[Number], list[Number]]:
    """Accelerations and the constraints' torques at the joints. state: the accelerations to begin with come third."""
    n, count = len(torque), len(constraints)
    pieces_there, result, before = (p.memory(VECTOR, size) for size in (2 * count, n, n))
    rounds = p.memory("i64", 1)
    p.store("i64", "0", rounds)

    def keep(a: Sequence[Number]) -> None:
        """Accelerations to go on from, and their pieces."""
        for k, (stiff, force) in enumerate(pieces(p, constraints, a)):
            store(p, stiff, pieces_there, 2 * k)
            store(p, force, pieces_there, 2 * k + 1)
        for i, x in enumerate(a):
            store(p, x, before, i)

    def kept() -> Pieces:
        return [(load(p, pieces_there, 2 * k), load(p, pieces_there, 2 * k + 1)) for k in range(count)]

    keep([load(p, state, 2 * n + i) for i in range(n)])
    newton, onward, solved = (p.label(word) for word in ("newton", "onward", "solved"))
    p.jump(newton)
    p.begin(newton)
    here = kept()
    a = solve(*restrained(mass, torque, constraints, here))
    differs = never(p)
    for old, new in zip(here, pieces(p, constraints, a), strict=True):
        for x, y in zip(old, new, strict=True):
            differs = differs | compared(p, "one", x, y)  # not in a row that has run away
    moved = never(p)  # at the end of a piece the two on its sides take turns, by what is lost in rounding
    for i, x in enumerate(a):
        y = load(p, before, i)
        moved = moved | compared(p, "ogt", size_of(p, x - y), ROUNDING * (size_of(p, x) + size_of(p, y)))
    differs = differs & moved
    for i in range(n):
        store(p, a[i], result, i)
    number = p.pure(f"add i64 {p.load('i64', rounds)}, 1")
    p.store("i64", number, rounds)
    more = p.pure(f"icmp slt i64 {number}, {MOST}")
    p.branch(p.pure(f"and i1 {differs.anywhere()}, {more}"), onward, solved)
    p.begin(onward)
    keep(least_on_the_way(p, mass, torque, constraints, [load(p, before, i) for i in range(n)], a))
    p.jump(newton)
    p.begin(solved)
    store(p, where(p, differs, 1.0, load(p, failed, 0)), failed, 0)
    a = [load(p, result, i) for i in range(n)]
    return a, forces(constraints, kept(), a)


def _limits(p: Program, stop: Stop, length: Number, rate: Number, numbers: Sequence[Lanes]) -> tuple[Limit, Limit]:
    """The lower and the upper limit of a length; numbers: both limits, K and B of the reference acceleration, inverse
    weight."""
    low, high, *rest = numbers
    return _limit(p, stop, length - low, rate, rest, 1.0), _limit(p, stop, high - length, -rate, rest, -1.0)


def _limit(p: Program, stop: Stop, distance: Number, rate: Number, numbers: Sequence[Lanes], side: float) -> Limit:
    """distance: from the limit, less than 0 beyond it; rate: of the distance; numbers: K, B and the inverse weight."""
    stiff, damp, weight = numbers
    low, high, width, middle, power = stop.solimp
    beyond = distance - stop.margin
    imp: Number
    if low == high or width <= 1e-15:
        imp = 0.5 * (low + high)
    else:
        x = smaller(p, size_of(p, beyond) / width, 1.0)
        y: Number = x
        if power == 2.0:
            rest = 1.0 - x
            y = where(p, x <= middle, x * x * (1.0 / middle), 1.0 - rest * rest * (1.0 / (1.0 - middle)))
        imp = low + y * (high - low)
    resistance = larger(p, (1.0 - imp) * weight / imp, 1e-15)
    near = compared(p, "olt", distance, stop.margin)
    return Limit(side, near, 1.0 / resistance, -(damp * rate) - stiff * imp * beyond)
