"""Rotations as three column vectors of elementwise arrays, for any array library."""

from math import cos, sin

from plants.scaler_arm.kinematics.geometry import Triple
from residual_mpc.effects.ops import Array, Ops

Vector = tuple[Array, Array, Array]
Rotation = tuple[Vector, Vector, Vector]  # the frame's x, y and z axis in the parent's frame


def constant(rpy: Triple) -> Rotation:
    """Fixed-axis roll, pitch, yaw rad (URDF): Rz(yaw) Ry(pitch) Rx(roll). What rounding leaves of a zero is zero."""
    (r, p, y) = rpy
    cr, sr, cp, sp, cy, sy = cos(r), sin(r), cos(p), sin(p), cos(y), sin(y)
    columns = (
        (cy * cp, sy * cp, -sp),
        (cy * sp * sr - sy * cr, sy * sp * sr + cy * cr, cp * sr),
        (cy * sp * cr + sy * sr, sy * sp * cr - cy * sr, cp * cr),
    )
    x, y_, z = ([0.0 if abs(v) < 1e-15 else v for v in c] for c in columns)
    return (x[0], x[1], x[2]), (y_[0], y_[1], y_[2]), (z[0], z[1], z[2])


def about_z(ops: Ops, frame: Rotation, angle: Array) -> Rotation:
    """The frame turned about its own z by angle rad."""
    c, s = ops.cos(angle), ops.sin(angle)
    x, y, z = frame
    return _mix(x, y, c, s), _mix(x, y, -s, c), z


def after(frame: Rotation, inner: Rotation) -> Rotation:
    """A frame that is `inner` in `frame`, in the parent of `frame`."""
    x, y, z = inner
    return apply(frame, x), apply(frame, y), apply(frame, z)


def apply(frame: Rotation, v: Vector | Triple) -> Vector:
    """A vector of the frame, in its parent."""
    x, y, z = frame
    return (
        x[0] * v[0] + y[0] * v[1] + z[0] * v[2],
        x[1] * v[0] + y[1] * v[1] + z[1] * v[2],
        x[2] * v[0] + y[2] * v[1] + z[2] * v[2],
    )


def transposed(frame: Rotation) -> Rotation:
    """The inverse rotation."""
    x, y, z = frame
    return (x[0], y[0], z[0]), (x[1], y[1], z[1]), (x[2], y[2], z[2])


def add(u: Vector | Triple, v: Vector | Triple) -> Vector:
    return u[0] + v[0], u[1] + v[1], u[2] + v[2]


def minus(u: Vector | Triple, v: Vector | Triple) -> Vector:
    return u[0] - v[0], u[1] - v[1], u[2] - v[2]


def cross(u: Vector | Triple, v: Vector | Triple) -> Vector:
    return u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]


def scaled(factor: Array, v: Vector) -> Vector:
    return factor * v[0], factor * v[1], factor * v[2]


def _mix(x: Vector, y: Vector, a: Array, b: Array) -> Vector:
    return a * x[0] + b * y[0], a * x[1] + b * y[1], a * x[2] + b * y[2]
