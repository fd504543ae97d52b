"""What the arm's weight asks of its motors: how far each body's mass rises for a turn of each motor, loop closed.

One source for numpy, JAX and CasADi, like the kinematics. The torque is 9.81 m/s^2 times mass times rise, summed.
"""

from collections.abc import Mapping, Sequence

from plants.scaler_arm.kinematics.five_bar import coupling, rod_turns
from plants.scaler_arm.kinematics.forward import Angles, Chain, posture
from plants.scaler_arm.kinematics.geometry import Arm, Triple
from plants.scaler_arm.kinematics.rotation import Vector, add, apply, minus
from residual_mpc.effects.ops import Array, Ops

GRAVITY = 9.81  # m/s^2
BODIES = ("shoulder", "a", "b", "f", "e", "wrist1", "wrist2", "wrist3", "gripper")

Rises = tuple[Array, Array, Array, Array, Array, Array]  # m/rad, in the order of MOTORS


def rises(ops: Ops, arm: Chain, q: Angles, points: Mapping[str, Sequence[Triple]]) -> dict[str, list[Rises]]:
    """For each body the points (m, in its frame) that are asked for: how far each rises for a turn of each motor.

    The shoulder turns about the vertical and lifts nothing. Points of "gripper" are in the gripper's frame.
    """
    at = posture(ops, arm, q)
    bar = arm.bar
    end_a, end_f, c = coupling(ops, bar, q[1], q[2])
    turn_a, turn_f = rod_turns(ops, bar, end_a, end_f, c)
    none = 0.0 * at.out[0]
    out: dict[str, list[Rises]] = {"shoulder": [(none,) * 6 for _ in points.get("shoulder", ())]}
    # in the plane a turn of 1 rad lifts a point by how far out it lies from the centre of the turn
    crank_a, crank_f = end_a[0] - bar.pivot_a[0], end_f[0] - bar.pivot_f[0]
    for name, zero, angle in (("a", bar.zero_a, q[1]), ("f", bar.zero_f, q[2])):
        x, z = ops.cos(zero + angle), ops.sin(zero + angle)
        outward = [x * p[0] - z * p[1] for p in points.get(name, ())]
        out[name] = [(none, r, none, none, none, none) if name == "a" else (none, none, r, *(none,) * 3)
                     for r in outward]  # fmt: skip
    along = (c[0] - end_a[0]) / bar.rod_b, (c[1] - end_a[1]) / bar.rod_b  # b's x axis
    outward = [along[0] * p[0] - along[1] * p[1] for p in points.get("b", ())]
    out["b"] = [(none, crank_a + turn_a[0] * r, turn_f[0] * r, none, none, none) for r in outward]
    start = at.end_f
    for k, name in enumerate(("e", "wrist1", "wrist2", "wrist3", "gripper")):
        origin = start if name == "e" else at.wrist_centre
        frame = at.frames[min(k, 3)]
        out[name] = []
        for point in points.get(name, ()):
            p = point if name != "gripper" else _in_wrist3(arm, point)
            arm_of = apply(frame, p)  # from the body's origin, in the mount's frame
            lever = minus(add(origin, arm_of), start)
            r = at.out[0] * lever[0] + at.out[1] * lever[1]
            wrist = [_lifted(at.axes[j], arm_of) if j < k else none for j in range(3)]
            out[name].append((none, turn_a[1] * r, crank_f + turn_f[1] * r, *wrist))
    return out


def masses(arm: Arm) -> dict[str, float]:
    """kg, of every body by name."""
    return {**{j.name: j.body.mass for j in arm.joints}, "gripper": arm.gripper_body.mass}


def centres(arm: Arm) -> dict[str, Triple]:
    """m, where every body's mass sits in its own frame."""
    return {**{j.name: j.body.com for j in arm.joints}, "gripper": arm.gripper_body.com}


def _in_wrist3(arm: Chain, point: Triple) -> tuple[float, float, float]:
    """A point of the gripper's frame, in wrist3's."""
    moved = apply(arm.gripper, point)
    return arm.gripper_at[0] + moved[0], arm.gripper_at[1] + moved[1], arm.gripper_at[2] + moved[2]


def _lifted(axis: Vector, lever: Vector) -> Array:
    """The vertical part of axis x lever."""
    return axis[0] * lever[1] - axis[1] * lever[0]
