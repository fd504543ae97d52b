"""Inverse kinematics of the SCALER arm in closed form, on the one branch that the joint limits allow."""

from math import atan2, hypot

import numpy as np

from plants.scaler_arm.kinematics.five_bar import meet
from plants.scaler_arm.kinematics.forward import Chain, chain, forward_kinematics
from plants.scaler_arm.kinematics.geometry import MOTORS, SCALER, Arm
from plants.scaler_arm.kinematics.rotation import Rotation, Vector, after, apply, minus, transposed
from residual_mpc.effects.ops import NUMPY, Array, Ops
from residual_mpc.errors import BadInput

NEAR = 1e-9  # m: the closed form is off by rounding alone, so that more means out of reach


def angles_of(ops: Ops, arm: Chain, tool: Vector, frame: Rotation) -> tuple[Array, ...]:
    """The six motor angles, rad, that bring the tool point (m) and its frame there; for any array library.

    The wrist centre follows from the tool, the shoulder turns the plane onto it, two meetings of circles give the
    cranks, and the wrist's three angles are read off the rotation that is left. Out of reach the circles clamp, as in
    `five_bar.meet`; `inverse_kinematics` raises instead.
    """
    wrist3 = after(frame, transposed(arm.gripper))
    centre = minus(tool, apply(wrist3, arm.tool))
    shoulder = ops.arctan2(centre[1], centre[0])
    w = _in_plane(ops, centre)
    bar = arm.bar
    end_f = meet(ops, w, (bar.pivot_f[0], bar.pivot_f[1]), _reach(arm), bar.crank_f, side=1.0)
    heading = ops.arctan2(w[1] - end_f[1], w[0] - end_f[0]) - atan2(arm.wrist_centre[1], arm.wrist_centre[0])
    lead = heading + bar.lead_e
    c = end_f[0] + bar.rod_e * ops.cos(lead), end_f[1] + bar.rod_e * ops.sin(lead)
    end_a = meet(ops, c, (bar.pivot_a[0], bar.pivot_a[1]), bar.rod_b, bar.crank_a, side=-1.0)
    a = ops.arctan2(end_a[1] - bar.pivot_a[1], end_a[0] - bar.pivot_a[0]) - bar.zero_a
    f = ops.arctan2(end_f[1] - bar.pivot_f[1], end_f[0] - bar.pivot_f[0]) - bar.zero_f
    return (shoulder, a, f, *_wrist(ops, arm, shoulder, heading, wrist3))


def inverse_kinematics(tool: np.ndarray, frame: np.ndarray, arm: Arm = SCALER) -> np.ndarray:
    """Motor angles (..., 6) rad for tool points (..., 3) m and frames (..., 3, 3), within the chosen joint limits.

    Raises Unreachable with the first point that is out of reach or beyond a limit.
    """
    tool, frame = np.asarray(tool, dtype=np.float64), np.asarray(frame, dtype=np.float64)
    links = chain(arm)
    columns = tuple(tuple(frame[..., i, j] for i in range(3)) for j in range(3))
    x, y, z = ((c[0], c[1], c[2]) for c in columns)
    q = np.stack(angles_of(NUMPY, links, (tool[..., 0], tool[..., 1], tool[..., 2]), (x, y, z)), axis=-1)
    came, _ = forward_kinematics(q, arm)
    off = np.linalg.norm(came - tool, axis=-1)
    low, high = (np.array([limit[i] for limit in arm.limits]) for i in (0, 1))
    beyond = (q < low - 1e-9) | (q > high + 1e-9)
    bad = (off > NEAR) | beyond.any(axis=-1)
    if bad.any():
        at = tuple(int(i) for i in np.argwhere(bad)[0])
        which = np.flatnonzero(beyond[at])
        raise Unreachable(at, tool[at], float(off[at]), q[at], tuple(MOTORS[i] for i in which), arm)
    return q


class Unreachable(BadInput):
    """A tool pose that the arm cannot take.

    index: of the pose in the arrays that came; tool (3,) m; off m: how far away the nearest tool point that was found
    is; angles (6,) rad that were found; beyond: motors past their limits.
    """

    def __init__(
        self,
        index: tuple[int, ...],
        tool: np.ndarray,
        off: float,
        angles: np.ndarray,
        beyond: tuple[str, ...],
        arm: Arm,
    ) -> None:
        self.index, self.tool, self.off, self.angles, self.beyond = index, tool, off, angles, beyond
        limits = dict(zip(MOTORS, arm.limits, strict=True))
        needs = "; ".join(
            f"needs {m} = {angles[MOTORS.index(m)]:.3f} rad, allowed range {limits[m][0]} to {limits[m][1]}"
            for m in beyond
        )
        x, y, z = tool
        super().__init__(
            f"tool pose {index} at ({x:.4f}, {y:.4f}, {z:.4f}) m "
            + (f"is out of reach by {off:.3g} m" if off > NEAR else needs),
            "inverse kinematics",
            "move the motion towards the centre of the workspace, or reduce its size",
        )


def _reach(arm: Chain) -> float:
    """From the end of link f to the wrist centre, m."""
    return hypot(arm.wrist_centre[0], arm.wrist_centre[1])


def _in_plane(ops: Ops, centre: Vector) -> tuple[Array, Array]:
    return ops.sqrt(centre[0] * centre[0] + centre[1] * centre[1]), centre[2]


def _wrist(ops: Ops, arm: Chain, shoulder: Array, heading: Array, wrist3: Rotation) -> tuple[Array, Array, Array]:
    """Wrist angles from what is left of the rotation: n = Rz(w1) M Rz(w2) M' Rz(w3), M and M' the frames of wrist2 and
    wrist3 in their parents. Their entries are 0 and 1, so that n's last column is (cos w1 cos w2, sin w1 cos w2,
    -sin w2) and its last row (-cos w2 sin w3, -cos w2 cos w3, -sin w2). Branch: cos w2 > 0.
    """
    c, s = ops.cos(shoulder), ops.sin(shoulder)
    x, z = ops.cos(heading), ops.sin(heading)
    e: Rotation = ((c * x, s * x, z), (-c * z, -s * z, x), (s, -c, 0.0 * c))
    n = after(transposed(after(e, arm.wrist[0])), wrist3)
    third = n[2]
    second = ops.arctan2(-third[2], ops.sqrt(third[0] * third[0] + third[1] * third[1]))
    return ops.arctan2(third[1], third[0]), second, ops.arctan2(-n[0][2], -n[1][2])
