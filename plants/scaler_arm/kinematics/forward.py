"""Forward kinematics, Jacobian and the task-space velocity of the SCALER arm, written once for every array library.

Angles are a tuple of six arrays of one shape, rad, in the order of `geometry.MOTORS`; results are tuples of arrays of
that shape, in the mount's frame. `forward_kinematics` and its like at the end take and give numpy arrays.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from plants.scaler_arm.kinematics.five_bar import FiveBar, coupling, direction, five_bar, passive, rod_turns
from plants.scaler_arm.kinematics.geometry import SCALER, Arm
from plants.scaler_arm.kinematics.rotation import (
    Rotation,
    Vector,
    about_z,
    add,
    after,
    apply,
    constant,
    cross,
    minus,
    scaled,
)
from residual_mpc.effects.ops import NUMPY, Array, Ops

Angles = Sequence[Array]  # six arrays of one shape, in the order of MOTORS


@dataclass(frozen=True)
class Chain:
    """What the equations need of an arm, worked out once: the linkage, and the constant frames behind it."""

    bar: FiveBar
    wrist_centre: tuple[float, float, float]  # m, in e
    wrist: tuple[Rotation, Rotation, Rotation]  # wrist1 in e, wrist2 in wrist1, wrist3 in wrist2
    gripper: Rotation  # in wrist3
    gripper_at: tuple[float, float, float]  # m, in wrist3
    tool: tuple[float, float, float]  # m, in wrist3


@lru_cache(maxsize=8)
def chain(arm: Arm = SCALER) -> Chain:
    """The constants of an arm."""
    wrist = tuple(arm.joint(f"wrist{i}").frame for i in (1, 2, 3))
    gripper = constant(arm.gripper.rpy)
    x, y, z = (float(v) for v in add(arm.gripper.xyz, apply(gripper, arm.tool)))
    return Chain(
        five_bar(arm),
        wrist[0].xyz,
        (constant(wrist[0].rpy), constant(wrist[1].rpy), constant(wrist[2].rpy)),
        gripper,
        arm.gripper.xyz,
        (x, y, z),
    )


@dataclass(frozen=True)
class Posture:
    """Where everything is, in the mount's frame; every entry an array of the angles' shape (or a constant).

    tool, wrist_centre, end_f (far end of link f) m; gripper: the tool's frame; axes: of the three wrist joints; out:
    the plane's outward direction; frames: of e, wrist1, wrist2 and wrist3.
    """

    tool: Vector
    gripper: Rotation
    wrist_centre: Vector
    end_f: Vector
    axes: tuple[Vector, Vector, Vector]
    out: Vector
    frames: tuple[Rotation, Rotation, Rotation, Rotation]


def posture(ops: Ops, arm: Chain, q: Angles) -> Posture:
    """The arm at motor angles q, the loop closed analytically (clamped at its singularity, see `five_bar`)."""
    out, side = _plane(ops, q[0])
    _, end_f, c = coupling(ops, arm.bar, q[1], q[2])
    e = _frame_e(ops, arm.bar, out, side, end_f, c)
    start = _lift(out, end_f)
    centre = add(start, apply(e, arm.wrist_centre))
    frames = [e]
    for turn, angle in zip(arm.wrist, q[3:], strict=True):
        frames.append(about_z(ops, after(frames[-1], turn), angle))
    tool = add(centre, apply(frames[3], arm.tool))
    axes = (frames[1][2], frames[2][2], frames[3][2])
    found = (frames[0], frames[1], frames[2], frames[3])
    return Posture(tool, after(frames[3], arm.gripper), centre, start, axes, out, found)


def tool_point(ops: Ops, arm: Chain, q: Angles) -> Vector:
    """FK(theta): the tool point, m."""
    return posture(ops, arm, q).tool


def columns(ops: Ops, arm: Chain, q: Angles) -> tuple[tuple[Vector, Vector], ...]:
    """The geometric Jacobian by motor: (m/rad of the tool point, rad/rad of its frame), in the order of MOTORS."""
    at = posture(ops, arm, q)
    out, side = _plane(ops, q[0])
    up = (0.0 * out[0], 0.0 * out[0], 1.0 + 0.0 * out[0])
    end_a, end_f, c = coupling(ops, arm.bar, q[1], q[2])
    turn_a, turn_f = rod_turns(ops, arm.bar, end_a, end_f, c)
    found = [(cross(up, at.tool), up)]
    lever = cross(side, minus(at.tool, at.end_f))  # what a turn of e does to the tool
    crank = cross(side, minus(at.end_f, _lift(out, (arm.bar.pivot_f[0], arm.bar.pivot_f[1]))))
    found.append((scaled(turn_a[1], lever), scaled(turn_a[1], side)))
    found.append((add(scaled(turn_f[1], lever), crank), scaled(turn_f[1], side)))
    arm_of_wrist = minus(at.tool, at.wrist_centre)
    found.extend((cross(axis, arm_of_wrist), axis) for axis in at.axes)
    return tuple(found)


def task_velocity(ops: Ops, arm: Chain, q: Angles, rates: Angles, dt: float) -> Vector:
    """(FK(theta + theta' dt) - FK(theta)) / dt, m/s: the paper's fk_prop without its residual.

    q, rates: six arrays each, rad and rad/s, of the step before; dt s.
    """
    ahead = tool_point(ops, arm, [x + v * dt for x, v in zip(q, rates, strict=True)])
    return scaled(1.0 / dt, minus(ahead, tool_point(ops, arm, q)))


def task_velocity_by_jacobian(ops: Ops, arm: Chain, q: Angles, rates: Angles) -> Vector:
    """J(theta) theta', m/s: the alternative that the paper mentions; fk_prop's limit for a short step."""
    total = None
    for (linear, _), rate in zip(columns(ops, arm, q), rates, strict=True):
        part = scaled(rate, linear)
        total = part if total is None else add(total, part)
    assert total is not None  # six columns
    return total


def forward_kinematics(q: np.ndarray, arm: Arm = SCALER) -> tuple[np.ndarray, np.ndarray]:
    """(tool point (..., 3) m, its frame (..., 3, 3)) at q (..., 6) rad."""
    at = posture(NUMPY, chain(arm), _split(q))
    return _stack(at.tool, q), np.stack([_stack(axis, q) for axis in at.gripper], axis=-1)


def jacobian(q: np.ndarray, arm: Arm = SCALER) -> np.ndarray:
    """(..., 6, 6): rows vx, vy, vz (m/s) and wx, wy, wz (rad/s) of the tool, a column a motor (rad/s); q (..., 6)."""
    found = columns(NUMPY, chain(arm), _split(q))
    return np.stack([np.concatenate([_stack(v, q), _stack(w, q)], axis=-1) for v, w in found], axis=-1)


def velocity(q: np.ndarray, rates: np.ndarray, dt: float, arm: Arm = SCALER) -> np.ndarray:
    """fk_prop without its residual: (..., 3) m/s from q, rates (..., 6) rad, rad/s, dt s."""
    return _stack(task_velocity(NUMPY, chain(arm), _split(q), _split(rates), dt), q)


def velocity_by_jacobian(q: np.ndarray, rates: np.ndarray, arm: Arm = SCALER) -> np.ndarray:
    """J(q) rates: (..., 3) m/s from q, rates (..., 6) rad, rad/s."""
    return _stack(task_velocity_by_jacobian(NUMPY, chain(arm), _split(q), _split(rates)), q)


def passive_angles(q: np.ndarray, arm: Arm = SCALER) -> np.ndarray:
    """(..., 2) rad of the joints b and e at motor angles q (..., 6)."""
    b, e = passive(NUMPY, chain(arm).bar, q[..., 1], q[..., 2])
    return np.stack([b, e], axis=-1)


def _plane(ops: Ops, shoulder: Array) -> tuple[Vector, Vector]:
    """(outward direction, the hinges' axis) of the linkage's plane: the shoulder's x and -y."""
    c, s = ops.cos(shoulder), ops.sin(shoulder)
    return (c, s, 0.0 * c), (s, -c, 0.0 * c)


def _lift(out: Vector, point: tuple[Array, Array]) -> Vector:
    """A point of the plane in the mount's frame."""
    return out[0] * point[0], out[1] * point[0], point[1] + 0.0 * out[0]


def _frame_e(
    ops: Ops, bar: FiveBar, out: Vector, side: Vector, end_f: tuple[Array, Array], c: tuple[Array, Array]
) -> Rotation:
    """The frame of link e: its x axis lies `lead_e` behind the way to the coupling point."""
    heading = direction(ops, c[0] - end_f[0], c[1] - end_f[1]) - bar.lead_e
    x, z = ops.cos(heading), ops.sin(heading)
    return _lift(out, (x, z)), _lift(out, (-z, x)), side


def _split(q: np.ndarray) -> list[np.ndarray]:
    return [q[..., i] for i in range(q.shape[-1])]


def _stack(v: Vector, q: np.ndarray) -> np.ndarray:
    """(..., 3) from three arrays or constants, in the shape of the angles q (..., 6)."""
    return np.stack([np.broadcast_to(x, q.shape[:-1]) for x in v], axis=-1)
