"""How the arm's position servos move its joints, without inertia; one source for numpy, JAX and CasADi.

A servo is a spring and a damper: gain (kp (u - q) - kv w) = b w + weight(q) + dry friction, in N m. Geared servos damp
so much (kv / inertia is 300 /s and more, against kp / kv of 10 /s) that their inertia is gone within a few ms, so that
joint angles alone are the state, as in the paper's task-space model. Over a step the weight is held, and the angle
follows its exponential exactly.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from plants.scaler_arm.dynamics.gravity import BODIES, GRAVITY, centres, rises
from plants.scaler_arm.kinematics.forward import Angles, Chain
from plants.scaler_arm.kinematics.geometry import Arm, Triple
from residual_mpc.effects.ops import Array, Ops, clip

CORNERS: tuple[Triple, ...] = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))  # of a frame


@dataclass(frozen=True)
class Load:
    """What hangs on the arm: masses kg by body, shifts m of some bodies' centres along the unit vectors `along`,
    payload kg at the tool, or `beside` m from it along the gripper's axes.
    """

    masses: Mapping[str, Array]
    payload: Array
    shifts: Mapping[str, Array]
    along: Mapping[str, Triple]
    beside: Sequence[Array] | None = None


@dataclass(frozen=True)
class Servo:
    """One motor's law: kp N m/rad and kv N m s/rad with gain and sag in them, b N m s/rad of the bearings, level N m of
    dry friction, None for none.
    """

    kp: Array
    kv: Array
    b: Array
    level: Array | None = None


def weights(ops: Ops, arm: Arm, links: Chain, q: Angles, load: Load) -> tuple[Array, ...]:
    """Six torques, N m, that hold the arm up at q."""
    points = {n: [centre] for n, centre in centres(arm).items()}
    points["gripper"] += [arm.tool, *(() if load.beside is None else CORNERS)]
    found = rises(ops, links, q, points)
    far = {n: [(0.0, 0.0, 0.0), load.along[n]] for n in load.shifts}
    shifted = rises(ops, links, q, far) if far else {}
    out = []
    for i in range(len(q)):
        _, tool, *corners = found["gripper"]
        lever = tool[i]
        for offset, tip in zip(load.beside or (), corners[1:], strict=True):
            lever = lever + offset * (tip[i] - corners[0][i])
        total = load.payload * lever
        for n in BODIES:
            total = total + load.masses[n] * found[n][0][i]
        for n, shift in load.shifts.items():
            origin, tip = shifted[n]
            total = total + load.masses[n] * shift * (tip[i] - origin[i])
        out.append(GRAVITY * total)
    return tuple(out)


def advance(ops: Ops, rough: Ops, law: Servo, error: Array, weight: Array, dt: float) -> Array:
    """rad that a joint turns within dt s from `error` rad behind its command. rough: the table for kinks in N m."""
    force = law.kp * error - weight
    if law.level is not None:
        force = force - clip(rough, force, -law.level, law.level)  # what dry friction holds
    return force / law.kp * (1.0 - ops.exp(-law.kp * dt / (law.kv + law.b)))


def torque(law: Servo, error: Array, speed: Array) -> Array:
    """N m that the motor gives."""
    return law.kp * error - law.kv * speed
