"""One step of MuJoCo's for a chain of hinges and slides: forces, constraints, integrator.

The equations are those of MuJoCo's documentation (Computation) and of its source, engine_forward.c,
engine_core_constraint.c and engine_derivative.c.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from plants.mujoco_robot.native.constraints import (
    MOST,
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
from plants.mujoco_robot.native.lanes import LANES, Lanes, Number, Program, dot, larger, smaller, where


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
    """A length, the sum of joint positions times `of`, with a spring that has a dead band; stop: of its limits, None
    without any."""

    of: Mapping[int, float]
    stop: Stop | None


@dataclass(frozen=True, eq=False)
class Chain:
    """An arm as the program has it, the same for all rows and any time step. implicit: whether servos' damping is
    implicit as well as that of the joints (implicitfast, against Euler); drawn: joint positions in the drawn posture;
    reach: of the torque of all of a joint's actuators. rubs: whether joints have dry friction; stops: of joints with
    limits."""

    implicit: bool
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
# B, inverse weight
JOINT = 12
ACTUATOR = 6  # of an actuator: gain, bias 3, range 2
TENDON = 8  # of a tendon: stiffness, ends of the dead band, lower and upper limit, their K and B, inverse weight


def sizes(chain: Chain) -> int:
    """Numbers of a row."""
    return _before_tendons(chain) + TENDON * len(chain.tendons)


def _before_tendons(chain: Chain) -> int:
    return ARM + (LINK + JOINT) * len(chain.joints) + ACTUATOR * len(chain.actuators)


@dataclass(frozen=True, eq=False)
class _Row:
    """The numbers of the rows, as they lie in memory."""

    p: Program
    array: Any
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
        at = ARM + LINK * len(self.chain.joints) + JOINT * i
        return [self._load(at + k) for k in range(JOINT)]

    def actuator(self, i: int) -> list[Lanes]:
        at = ARM + (LINK + JOINT) * len(self.chain.joints) + ACTUATOR * i
        return [self._load(at + k) for k in range(ACTUATOR)]

    def tendon(self, i: int) -> list[Lanes]:
        at = _before_tendons(self.chain) + TENDON * i
        return [self._load(at + k) for k in range(TENDON)]

    def _load(self, at: int) -> Lanes:
        return self.p.load(self.array, at)


def trace(p: Program, chain: Chain, numbers: Any, state: Any, controls: Any, outputs: Any, failed: Any) -> None:
    """Add one step to the program, from arrays of vectors. state: positions, velocities, then the accelerations that
    the solver begins with; outputs (nu): written; failed (1): 1 where the constraints' solver has not converged."""
    n, row = len(chain.joints), _Row(p, numbers, chain)
    h = row.step
    q, v = ([p.load(state, k * n + i) for i in range(n)] for k in (0, 1))
    off = [x - x0 for x, x0 in zip(q, chain.drawn, strict=True)]
    links = [row.link(i) for i in range(n)]
    mass, bias = inertia_and_bias(p, chain.joints, links, row.gravity, off, v)
    joints = [row.joint(i) for i in range(n)]
    torque: list[Number] = [-b for b in bias]
    driven, damping = _actuated(p, chain, row, q, v, controls, outputs)
    for i, (armature, damp, stiff, rest, *_) in enumerate(joints):
        mass[i, i] = mass[i, i] + armature
        torque[i] = torque[i] + driven[i] - stiff * (q[i] - rest) - damp * v[i]
        damping[i] = damp + (damping[i] if chain.implicit else 0.0)
    constraints = [
        Constraint(
            {i: 1.0},
            Friction(loss, k, -(b * v[i])) if chain.rubs else None,
            () if one is None else _limits(p, one, q[i], v[i], stop),
        )
        for i, (one, (_, _, _, _, loss, k, b, *stop)) in enumerate(zip(chain.stops, joints, strict=True))
    ]
    constraints = [c for c in constraints if c.friction is not None or c.limits]
    for t, tendon in enumerate(chain.tendons):
        stiff, from_, to, *stop = row.tendon(t)
        length, rate = (dot([x[i] for i in tendon.of], list(tendon.of.values())) for x in (q, v))
        pull = stiff * (larger(p, from_ - length, 0.0) + smaller(p, to - length, 0.0))
        for i, c in tendon.of.items():
            torque[i] = torque[i] + pull * c
        if tendon.stop is not None:
            constraints.append(Constraint(tendon.of, None, _limits(p, tendon.stop, length, rate, stop)))
    free: list[Number] = list(torque)
    keep: list[Number] | None = None
    if constraints:
        keep, held = _constrained(p, mass, torque, constraints, state, failed)
        free = [t + f for t, f in zip(torque, held, strict=True)]
    a = solve({(i, j): m + damping[i] * h if i == j else m for (i, j), m in mass.items()}, free)
    keep = a if keep is None else keep
    for i in range(n):
        after = v[i] + h * a[i]
        p.store(q[i] + h * after, state, i)
        p.store(after, state, n + i)
        p.store(keep[i], state, 2 * n + i)


def _actuated(
    p: Program, chain: Chain, row: _Row, q: Sequence[Lanes], v: Sequence[Lanes], controls: Any, outputs: Any
) -> tuple[list[Number], list[Number]]:
    """Torques at the joints, and how they fall with the joints' velocities; an actuator at the end of its range has no
    damping."""
    n = len(chain.joints)
    torque: list[Number] = [0.0] * n
    damping: list[Number] = [0.0] * n
    for i, actuator in enumerate(chain.actuators):
        gain, b0, b1, b2, low, high = row.actuator(i)
        u = p.load(controls, i)
        if actuator.clamp is not None:
            u = smaller(p, larger(p, u, actuator.clamp[0]), actuator.clamp[1])
        j, gear = actuator.joint, actuator.gear
        force = gain * u + b0 + b1 * (q[j] * gear) + b2 * (v[j] * gear)
        slope: Number = b2
        if actuator.limited:
            inside = p.builder.and_(force > low, force < high)
            slope = where(p, inside, b2, 0.0)
            force = smaller(p, larger(p, force, low), high)  # type: ignore[arg-type]
        p.store(force, outputs, i)
        torque[j] = torque[j] + gear * force
        damping[j] = damping[j] - gear * gear * slope
    for j, reach in enumerate(chain.reach):
        if reach is not None:
            torque[j] = smaller(p, larger(p, torque[j], reach[0]), reach[1])
    return torque, damping


def _constrained(
    p: Program,
    mass: Mass,
    torque: Sequence[Number],
    constraints: Sequence[Constraint],
    state: Any,
    failed: Any,
) -> tuple[list[Number], list[Number]]:
    """Accelerations and the constraints' torques at the joints. state: the accelerations to begin with come third."""
    n, count, builder, whole = len(torque), len(constraints), p.builder, p.ir.IntType(32)
    pieces_there, result, before = p.memory(p.vector, 2 * count), p.memory(p.vector, n), p.memory(p.vector, n)
    rounds = p.memory(whole, 1)
    builder.store(whole(0), rounds)

    def keep(a: Sequence[Number]) -> None:
        """Accelerations to go on from, and their pieces."""
        for k, (stiff, force) in enumerate(pieces(p, constraints, a)):
            p.store(stiff, pieces_there, 2 * k)
            p.store(force, pieces_there, 2 * k + 1)
        for i, x in enumerate(a):
            p.store(x, before, i)

    keep([p.load(state, 2 * n + i) for i in range(n)])
    newton, onward, solved = (builder.append_basic_block(x) for x in ("newton", "onward", "solved"))
    builder.branch(newton)
    builder.position_at_end(newton)
    here: Pieces = [(p.load(pieces_there, 2 * k), p.load(pieces_there, 2 * k + 1)) for k in range(count)]
    a = solve(*restrained(mass, torque, constraints, here))
    differs = p.ir.Constant(p.ir.VectorType(p.ir.IntType(1), LANES), None)
    for old, new in zip(here, pieces(p, constraints, a), strict=True):
        for x, y in zip(old, new, strict=True):
            differs = builder.or_(differs, builder.fcmp_unordered("!=", p.value(x), p.value(y)))
    for i in range(n):
        p.store(a[i], result, i)
    number = builder.add(builder.load(rounds), whole(1))
    builder.store(number, rounds)
    builder.cbranch(builder.and_(p.any(differs), builder.icmp_signed("<", number, whole(MOST))), onward, solved)
    builder.position_at_end(onward)
    keep(least_on_the_way(p, mass, torque, constraints, [p.load(before, i) for i in range(n)], a))
    builder.branch(newton)
    builder.position_at_end(solved)
    p.store(where(p, differs, 1.0, p.load(failed, 0)), failed, 0)
    a = [p.load(result, i) for i in range(n)]
    here = [(p.load(pieces_there, 2 * k), p.load(pieces_there, 2 * k + 1)) for k in range(count)]
    return a, forces(constraints, here, a)


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
        x = smaller(p, p.call("fabs", beyond) / width, 1.0)
        y: Number = x
        if power == 2.0:
            rest = 1.0 - x
            y = where(p, x <= middle, x * x * (1.0 / middle), 1.0 - rest * rest * (1.0 / (1.0 - middle)))
        imp = low + y * (high - low)
    resistance = larger(p, (1.0 - imp) * weight / imp, 1e-15)
    near = p.builder.fcmp_ordered("<", p.value(distance), p.value(stop.margin))
    return Limit(side, near, 1.0 / resistance, -(damp * rate) - stiff * imp * beyond)
