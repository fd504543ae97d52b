"""Accelerations of a chain of hinges and slides as MuJoCo has them: forces, constraints, implicit damping.

The equations are those of MuJoCo's documentation (Computation) and of its source, engine_forward.c,
engine_core_constraint.c and engine_derivative.c.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

from plants.mujoco_robot.native.chain import DAMPS, Chain, Equality, Row, Stop
from plants.mujoco_robot.native.constraints import (
    MOST,
    ROUNDING,
    Constraint,
    Friction,
    Limit,
    Mass,
    Pieces,
    Tie,
    forces,
    least_on_the_way,
    pieces,
    restrained,
    solve,
)  # fmt: skip
from plants.mujoco_robot.native.dynamics import inertia_and_bias
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
        stiff, from_, to, *stop, damp, loss, k, b = row.tendon(t)
        length, rate = (dot([x[i] for i, _ in tendon.of], [c for _, c in tendon.of]) for x in (q, v))
        pull = stiff * (larger(p, from_ - length, 0.0) + smaller(p, to - length, 0.0)) - damp * rate
        for i, c in tendon.of:
            torque[i] = torque[i] + pull * c
        friction = Friction(loss, k, -(b * rate)) if tendon.rubs else None
        limits = () if tendon.stop is None else _limits(p, tendon.stop, length, rate, stop)
        if friction is not None or limits:
            constraints.append(Constraint(dict(tendon.of), friction, limits))
    constraints += [_followed(p, e, off, v, row.equality(i)) for i, e in enumerate(chain.equalities)]
    free: list[Number] = list(torque)
    keep: list[Number] | None = None
    if constraints:
        keep, held = _constrained(p, mass, torque, constraints, state, failed)
        free = [t + f for t, f in zip(torque, held, strict=True)]
    implicit = {(i, j): m + damping[i] * h if i == j else m for (i, j), m in mass.items()}
    for t, tendon in enumerate(chain.tendons if chain.integrator == "implicitfast" else ()):
        slowed = row.tendon(t)[DAMPS] * h
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


def _followed(
    p: Program, e: Equality, off: Sequence[Lanes], v: Sequence[Lanes], numbers: Sequence[Lanes]
) -> Constraint:
    """off: joint positions from the drawn posture; numbers: K, B and the inverse weight."""
    stiff, damp, weight = numbers
    of = {e.joint: 1.0} | ({} if e.other is None else {e.other: -e.slope})
    ahead, rate = (dot([x[i] for i in of], list(of.values())) for x in (off, v))
    away = ahead - e.begin
    imp = _impedance(p, e.solimp, away)
    resistance = larger(p, (1.0 - imp) * weight / imp, 1e-15)
    return Constraint(of, None, (), Tie(1.0 / resistance, -(damp * rate) - stiff * imp * away))


def _limit(p: Program, stop: Stop, distance: Number, rate: Number, numbers: Sequence[Lanes], side: float) -> Limit:
    """distance: from the limit, less than 0 beyond it; rate: of the distance; numbers: K, B and the inverse weight."""
    stiff, damp, weight = numbers
    beyond = distance - stop.margin
    imp = _impedance(p, stop.solimp, beyond)
    resistance = larger(p, (1.0 - imp) * weight / imp, 1e-15)
    near = compared(p, "olt", distance, stop.margin)
    return Limit(side, near, 1.0 / resistance, -(damp * rate) - stiff * imp * beyond)


def _impedance(p: Program, solimp: tuple[float, float, float, float, float], away: Number) -> Number:
    """MuJoCo's impedance at a distance from where a constraint begins to act."""
    low, high, width, middle, power = solimp
    if low == high or width <= 1e-15:
        return 0.5 * (low + high)
    x = smaller(p, size_of(p, away) / width, 1.0)
    y: Number = x
    if power == 2.0:
        rest = 1.0 - x
        y = where(p, x <= middle, x * x * (1.0 / middle), 1.0 - rest * rest * (1.0 / (1.0 - middle)))
    return low + y * (high - low)
