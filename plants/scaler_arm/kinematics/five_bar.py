"""The five-bar linkage in its own plane, closed analytically; one source for numpy, JAX and CasADi.

The plane is the shoulder frame's x and z: a point is (x, z), an angle turns x towards z. Every function takes the table
of operations of one array library and works elementwise on that library's arrays of any one shape.

Singularities. The two rods b and e reach a common point only while the distance of their ends lies between the
difference and the sum of their lengths; on the border they are parallel and the loop's rates blow up. (With these
lengths that is where links a and f cross and their ends all but touch.) The chosen joint limits keep at least
LEAST_SINE between the rods. Beyond the border nothing raises and nothing is NaN, as a batch wants it: the point is
clamped to the nearest that there is, the loop then stays open, and `margin` is below 0 to tell.
"""

from dataclasses import dataclass
from math import atan2, hypot

from plants.scaler_arm.kinematics.geometry import Arm, Triple
from residual_mpc.effects.ops import Array, Ops, clip

Point = tuple[Array, Array]  # (x, z) m in the shoulder's plane

LEAST_SINE = 0.45  # of the angle between the rods, over the chosen joint limits
NEARLY_FLAT = 1e-9  # smallest square under a root or in a denominator: finite values and gradients on the border


@dataclass(frozen=True)
class FiveBar:
    """The linkage's constants, m and rad, from an arm's frames."""

    pivot_a: tuple[float, float]
    pivot_f: tuple[float, float]
    crank_a: float  # length of link a; f's follows
    crank_f: float
    zero_a: float  # angle of link a at q = 0
    zero_f: float
    rod_b: float
    rod_e: float
    zero_b: float  # angle of rod b against link a at q_b = 0
    zero_e: float  # angle of e's x axis against link f at q_e = 0
    lead_e: float  # angle of the coupling point in e, against e's x axis


def five_bar(arm: Arm) -> FiveBar:
    """The linkage of an arm whose cranks and rods all turn about the shoulder's -y."""
    a, b, f, e = (arm.joint(name) for name in ("a", "b", "f", "e"))
    return FiveBar(
        pivot_a=(a.frame.xyz[0], a.frame.xyz[2]),
        pivot_f=(f.frame.xyz[0], f.frame.xyz[2]),
        crank_a=_length(b.frame.xyz),
        crank_f=_length(e.frame.xyz),
        zero_a=-a.frame.rpy[1],  # the pitch turns x from +x to -z
        zero_f=-f.frame.rpy[1],
        rod_b=_length(arm.on_b),
        rod_e=_length(arm.on_e),
        zero_b=b.frame.rpy[2],
        zero_e=e.frame.rpy[2],
        lead_e=atan2(arm.on_e[1], arm.on_e[0]),
    )


def _length(v: Triple) -> float:
    return hypot(v[0], v[1])


def polar(ops: Ops, centre: Point | tuple[float, float], length: float, angle: Array) -> Point:
    """The point at that distance and angle from centre."""
    return centre[0] + length * ops.cos(angle), centre[1] + length * ops.sin(angle)


def meet(ops: Ops, p: Point, q: Point, from_p: float, from_q: float, side: float) -> Point:
    """Where the circles about p and q meet: side +1 to the left on the way from q to p, -1 to the right.

    Circles that do not meet give the point of q's circle that is nearest to p's; see `margin`.
    """
    dx, dz = p[0] - q[0], p[1] - q[1]
    square = ops.maximum(dx * dx + dz * dz, NEARLY_FLAT)  # m^2: the centres may coincide
    furthest = from_q / ops.sqrt(square)
    # share of the way from q to p, and beside it
    along = clip(ops, 0.5 * (1.0 + (from_q**2 - from_p**2) / square), -furthest, furthest)
    across = side * ops.sqrt(ops.maximum(from_q**2 / square - along * along, NEARLY_FLAT))
    return q[0] + along * dx - across * dz, q[1] + along * dz + across * dx


def meeting_sine(p: Point, q: Point, from_p: float, from_q: float) -> Array:
    """Squared sine of the angle between the two radii where the circles meet; below 0 where they do not."""
    square = (p[0] - q[0]) ** 2 + (p[1] - q[1]) ** 2
    cosine = (from_p**2 + from_q**2 - square) / (2.0 * from_p * from_q)
    return 1.0 - cosine * cosine


def crank_ends(ops: Ops, bar: FiveBar, a: Array, f: Array) -> tuple[Point, Point]:
    """The far ends of links a and f, at motor angles a and f rad."""
    return (
        polar(ops, bar.pivot_a, bar.crank_a, bar.zero_a + a),
        polar(ops, bar.pivot_f, bar.crank_f, bar.zero_f + f),
    )


def coupling(ops: Ops, bar: FiveBar, a: Array, f: Array) -> tuple[Point, Point, Point]:
    """(end of a, end of f, coupling point). The branch is that of the published zero pose: below the crank's ends."""
    end_a, end_f = crank_ends(ops, bar, a, f)
    return end_a, end_f, meet(ops, end_a, end_f, bar.rod_b, bar.rod_e, side=1.0)


def passive(ops: Ops, bar: FiveBar, a: Array, f: Array) -> tuple[Array, Array]:
    """Angles (b, e) rad of the joints without a motor, within (-pi, pi]."""
    end_a, end_f, c = coupling(ops, bar, a, f)
    b = _angle_from(ops, bar.zero_a + a + bar.zero_b, end_a, c)
    e = _angle_from(ops, bar.zero_f + f + bar.zero_e + bar.lead_e, end_f, c)
    return b, e


def passive_rates(ops: Ops, bar: FiveBar, a: Array, f: Array, rate_a: Array, rate_f: Array) -> tuple[Array, Array]:
    """Rates (b, e) rad/s of the joints without a motor, from the motors' rates rad/s."""
    end_a, end_f, c = coupling(ops, bar, a, f)
    turn_a, turn_f = rod_turns(ops, bar, end_a, end_f, c)
    b = turn_a[0] * rate_a + turn_f[0] * rate_f - rate_a
    e = turn_a[1] * rate_a + turn_f[1] * rate_f - rate_f
    return b, e


def rod_turns(
    ops: Ops, bar: FiveBar, end_a: Point, end_f: Point, c: Point
) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """What one rad of crank a, and of crank f, turns the rods (b, e) in the plane, rad.

    The coupling point moves with either rod alike: end_a' + turn_b x (c - end_a) = end_f' + turn_e x (c - end_f).
    Projecting on one rod rids the equation of the other's turn.
    """
    rb, re = (c[0] - end_a[0], c[1] - end_a[1]), (c[0] - end_f[0], c[1] - end_f[1])
    # rod_b rod_e sin: below 0 on the branch, 0 where the rods are parallel
    cross = ops.minimum(rb[0] * re[1] - rb[1] * re[0], -NEARLY_FLAT)
    la = (end_a[0] - bar.pivot_a[0], end_a[1] - bar.pivot_a[1])
    lf = (end_f[0] - bar.pivot_f[0], end_f[1] - bar.pivot_f[1])
    va, vf = (-la[1], la[0]), (-lf[1], lf[0])  # velocity of each crank's end per rad
    # b: (va da - vf df) . re + turn_b perp(rb) . re = 0, and perp(rb) . re = -(re x rb) = cross
    # e: (va da - vf df) . rb = turn_e perp(re) . rb, and perp(re) . rb = -cross
    return (
        (-_dot(va, re) / cross, -_dot(va, rb) / cross),
        (_dot(vf, re) / cross, _dot(vf, rb) / cross),
    )


def margin(ops: Ops, bar: FiveBar, a: Array, f: Array) -> Array:
    """Squared sine of the angle between the rods: 0 at the singularity, below 0 where the loop cannot close."""
    end_a, end_f = crank_ends(ops, bar, a, f)
    return meeting_sine(end_a, end_f, bar.rod_b, bar.rod_e)


def _dot(u: Point, v: Point) -> Array:
    return u[0] * v[0] + u[1] * v[1]


def _angle_from(ops: Ops, heading: Array, start: Point, end: Point) -> Array:
    """Angle from the heading (rad) to the way from start to end, within (-pi, pi]."""
    ux, uz = ops.cos(heading), ops.sin(heading)
    dx, dz = end[0] - start[0], end[1] - start[1]
    return direction(ops, ux * dx + uz * dz, ux * dz - uz * dx)


def direction(ops: Ops, dx: Array, dz: Array) -> Array:
    """Angle of the way (dx, dz) m; 0, with finite slopes, where there is none (links a and f end in one point)."""
    nowhere = dx * dx + dz * dz < NEARLY_FLAT
    return ops.arctan2(ops.where(nowhere, 0.0 * dz, dz), ops.where(nowhere, 1.0 + 0.0 * dx, dx))
