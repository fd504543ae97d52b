"""Inertia matrix and bias forces of a chain of links, in the frame of the ground.

Featherstone, Rigid Body Dynamics Algorithms (2008): the bias forces are the recursive Newton-Euler algorithm without
accelerations (table 5.1), the inertia matrix is the composite rigid body algorithm (table 6.2). Spatial vectors are
taken about the ground's origin, angular part first, so that composite inertias are sums.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from plants.mujoco_robot.native.elementary import sine_and_cosine
from plants.mujoco_robot.native.lanes import Lanes, Number, Three, added, cross, dot, times
from plants.mujoco_robot.native.program import Program


@dataclass(frozen=True)
class Joint:
    """A link's joint and where it is. parent: the link before it, -1 for the ground; slides: whether it slides along
    its axis in place of turning about it; turn: the axes of the link, one after another, in those of its parent at
    joint position 0, the joint's axis last."""

    parent: int
    slides: bool
    turn: tuple[tuple[float, float, float], ...]


@dataclass(frozen=True, eq=False)
class LinkNumbers:
    """What may differ from row to row. place: of the joint in the parent's axes, m; centre: of mass in the link's axes,
    m; inertia: about the centre, xx, yy, zz, xy, xz, yz, kg m^2."""

    place: Three
    mass: Number
    centre: Three
    inertia: tuple[Number, ...]


@dataclass(frozen=True, eq=False)
class _Inertia:
    """About the origin: mass, mass times centre, and second moments xx, yy, zz, xy, xz, yz."""

    mass: Number
    first: Three
    second: tuple[Number, ...]

    def __add__(self, other: _Inertia) -> _Inertia:
        second = tuple(a + b for a, b in zip(self.second, other.second, strict=True))
        return _Inertia(self.mass + other.mass, added(self.first, other.first), second)

    def momentum(self, turn: Three, move: Three) -> tuple[Three, Three]:
        """Angular and linear, of a motion (angular, linear velocity of what is at the origin)."""
        linear = added(times(move, self.mass), cross(turn, self.first))
        return added(_symmetric(self.second, turn), cross(self.first, move)), linear


def inertia_and_bias(
    p: Program,
    joints: Sequence[Joint],
    links: Sequence[LinkNumbers],
    gravity: Three,
    q: Sequence[Lanes],
    v: Sequence[Lanes],
) -> tuple[dict[tuple[int, int], Number], list[Number]]:
    """M[i, j] for j <= i where it is not 0, kg m^2, and the bias forces, N m; q (rad or m) from the drawn posture."""
    n = len(joints)
    axes, place, motion = _placed(p, joints, links, q)
    speed: list[tuple[Three, Three]] = []
    acceleration: list[tuple[Three, Three]] = []
    inertia: list[_Inertia] = []
    force: list[tuple[Three, Three]] = []
    still: Three = (0.0, 0.0, 0.0)
    for i, (joint, link) in enumerate(zip(joints, links, strict=True)):
        first = joint.parent < 0
        w0, v0 = (still, still) if first else speed[joint.parent]
        dw0, dv0 = (still, times(gravity, -1.0)) if first else acceleration[joint.parent]
        sw, sv = motion[i]
        w, u = added(w0, times(sw, v[i])), added(v0, times(sv, v[i]))
        speed.append((w, u))
        # S changes as its parent's frame moves: (w0, v0) x S
        acceleration.append((
            added(dw0, times(cross(w0, sw), v[i])),
            added(dv0, times(added(cross(w0, sv), cross(v0, sw)), v[i])),
        ))  # fmt: skip
        inertia.append(_about_origin(axes[i], place[i], link))
        angular, linear = inertia[i].momentum(w, u)
        rate = inertia[i].momentum(*acceleration[i])
        force.append((
            added(rate[0], added(cross(w, angular), cross(u, linear))),
            added(rate[1], cross(w, linear)),
        ))  # fmt: skip
    bias: list[Number] = [0.0] * n
    mass: dict[tuple[int, int], Number] = {}
    for i in range(n - 1, -1, -1):
        bias[i] = dot(motion[i][0], force[i][0]) + dot(motion[i][1], force[i][1])
        moved = inertia[i].momentum(*motion[i])
        j = i
        while j >= 0:
            mass[i, j] = dot(motion[j][0], moved[0]) + dot(motion[j][1], moved[1])
            j = joints[j].parent
        parent = joints[i].parent
        if parent >= 0:
            inertia[parent] = inertia[parent] + inertia[i]
            force[parent] = added(force[parent][0], force[i][0]), added(force[parent][1], force[i][1])
    return mass, bias


def gravity_torques(
    p: Program, joints: Sequence[Joint], links: Sequence[LinkNumbers], gravity: Three, q: Sequence[Lanes]
) -> list[Number]:
    """The bias forces at rest, N m, without inertias: -S_i . (h x g, m g), with m and h the mass and the mass times
    centre of all that joint i carries."""
    axes, place, motion = _placed(p, joints, links, q)
    mass: list[Number] = [link.mass for link in links]
    first = [
        times(added(at, _in(turned, link.centre)), link.mass)
        for at, turned, link in zip(place, axes, links, strict=True)
    ]
    out: list[Number] = [0.0] * len(joints)
    for i in range(len(joints) - 1, -1, -1):
        turn, move = motion[i]
        out[i] = -1.0 * (dot(turn, cross(first[i], gravity)) + dot(move, times(gravity, mass[i])))
        parent = joints[i].parent
        if parent >= 0:
            mass[parent], first[parent] = mass[parent] + mass[i], added(first[parent], first[i])
    return out


def _placed(
    p: Program, joints: Sequence[Joint], links: Sequence[LinkNumbers], q: Sequence[Lanes]
) -> tuple[list[list[Three]], list[Three], list[tuple[Three, Three]]]:
    """Of each link its axes, in columns, and its joint's place and motion S (angular, linear), all in the base's
    axes."""
    axes: list[list[Three]] = []
    place: list[Three] = []
    motion: list[tuple[Three, Three]] = []
    still: Three = (0.0, 0.0, 0.0)
    for i, (joint, link) in enumerate(zip(joints, links, strict=True)):
        first = joint.parent < 0
        before: list[Three] = [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)] if first else axes[joint.parent]
        at = added(still if first else place[joint.parent], _in(before, link.place))
        x, y, z = (_in(before, axis) for axis in joint.turn)
        if joint.slides:
            at = added(at, times(z, q[i]))
            motion.append((still, z))
        else:
            s, c = sine_and_cosine(p, q[i])
            x, y = added(times(x, c), times(y, s)), added(times(y, c), times(x, -s))
            motion.append((z, cross(at, z)))
        axes.append([x, y, z])
        place.append(at)
    return axes, place, motion


def _in(columns: Sequence[Three], x: Three) -> Three:
    """A vector in other axes."""
    return added(times(columns[0], x[0]), added(times(columns[1], x[1]), times(columns[2], x[2])))


def _symmetric(m: Sequence[Number], x: Three) -> Three:
    xx, yy, zz, xy, xz, yz = m
    return dot((xx, xy, xz), x), dot((xy, yy, yz), x), dot((xz, yz, zz), x)


def _about_origin(columns: Sequence[Three], at: Three, link: LinkNumbers) -> _Inertia:
    """R I R^T + m (|c|^2 1 - c c^T), c the centre of mass from the origin."""
    c = added(at, _in(columns, link.centre))
    first = times(c, link.mass)
    rows = [tuple(column[k] for column in columns) for k in range(3)]  # of R
    turned = [_symmetric(link.inertia, row) for row in rows]  # type: ignore[arg-type]  # rows of R I
    own = [dot(turned[a], rows[b]) for a, b in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    around = (
        dot(c[1:], first[1:]),
        c[0] * first[0] + c[2] * first[2],
        dot(c[:2], first[:2]),
        -(c[0] * first[1]),
        -(c[0] * first[2]),
        -(c[1] * first[2]),
    )
    return _Inertia(link.mass, first, tuple(a + b for a, b in zip(own, around, strict=True)))
