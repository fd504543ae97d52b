"""The body that a driving robot's planar pose belongs to: its free joint, how it stands, and how its wheels roll."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from residual_mpc.errors import BadInput

if TYPE_CHECKING:
    import mujoco

PLANAR = ("x", "y", "theta")
SETTLING = 2.0  # s that a robot is given to come to rest on the ground
AT_REST = 0.05  # m/s, rad/s: above this after SETTLING it has no ground, or falls over
ROLLS = 1e-6  # m: a joint whose speed moves no contact point by more than this, per radian, is no wheel


@dataclass(frozen=True, eq=False)
class Base:
    """A free body that stands on the ground.

    body: its number. q, v: where its free joint begins in qpos (7 entries) and qvel (6). height: m, and upright:
    (4,) quaternion (w, x, y, z) at zero heading, both as it stands at rest. rolling (joints, 3): speed of every hinge
    and slide joint when the robot rolls without slipping at a body-frame twist of (forward m/s, sideways m/s, yaw
    rad/s); zero rows are no wheels.
    """

    body: int
    q: int
    v: int
    height: float
    upright: np.ndarray
    rolling: np.ndarray

    def write(self, q: np.ndarray, v: np.ndarray, start: Mapping[str, np.ndarray]) -> np.ndarray:
        """Set position (B, nq) and velocity (B, nv) from pose.* and twist.*, (B,) each, standing on the ground.

        Returns (B, joints): the speeds at which the wheels roll at that twist.
        """
        theta = start["pose.theta"]
        q[:, self.q] = start["pose.x"]
        q[:, self.q + 1] = start["pose.y"]
        q[:, self.q + 2] = self.height
        q[:, self.q + 3 : self.q + 7] = _turned(theta, self.upright)
        vx, vy, yaw = (start[f"twist.{a}"] for a in PLANAR)
        v[:, self.v : self.v + 6] = 0.0
        v[:, self.v], v[:, self.v + 1] = vx, vy
        # MuJoCo's angular velocity is in the body's own axes
        v[:, self.v + 3 : self.v + 6] = yaw[:, None] * _upward(self.upright)
        c, s = np.cos(theta), np.sin(theta)
        twist = np.stack([c * vx + s * vy, c * vy - s * vx, yaw], axis=1)
        return np.asarray(twist @ self.rolling.T)

    def read(self, channel: str, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """One of pose.* and twist.* from positions (..., nq) and velocities (..., nv); theta is wrapped."""
        kind, axis = channel.split(".")
        if axis != "theta":
            k = PLANAR.index(axis)
            return np.asarray(q[..., self.q + k] if kind == "pose" else v[..., self.v + k])
        turn = q[..., self.q + 3 : self.q + 7]
        if kind == "pose":
            return yaw_of(turn)
        return np.asarray((_upward(turn) * v[..., self.v + 3 : self.v + 6]).sum(axis=-1))


def find_base(model: "mujoco.MjModel", pose_body: str | None, path: str) -> Base | None:
    """The base named by `pose_body`; None for a robot that is fixed to the world.

    Raises BadInput where the body is missing, has no free joint, or does not come to rest on the ground, and where none
    is named and a free body has motors.
    """
    free = {model.body(b).name: b for b in free_bodies(model)}
    if pose_body is None:
        driving = [model.body(b).name or f"number {b}, which needs a name" for b in driving_bodies(model)]
        if driving:
            each = " and ".join(driving)
            raise BadInput(
                f"body {each} {'has' if len(driving) == 1 else 'have'} a free joint and motors",
                path,
                f'for a mobile robot, set pose_body = "{driving[0]}" in the robot file; else fix the body to the world',
            )
        return None
    if not pose_body or pose_body not in free:
        raise BadInput(
            f"pose_body must be a body with a free joint, got {pose_body!r}; "
            f"bodies with a free joint: {', '.join(filter(None, free)) or 'none'}",
            path,
            "give a <freejoint/> to the robot's chassis, and name the chassis",
        )
    body = free[pose_body]
    joint = int(model.body_jntadr[body])
    q, v = int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])
    data = _at_rest(model, v, pose_body, path)
    turn = data.qpos[q + 3 : q + 7].copy()
    upright = _turned(-yaw_of(turn)[None], turn)[0]
    return Base(body, q, v, float(data.qpos[q + 2]), upright, _rolling(model, data, q, v))


def free_bodies(model: "mujoco.MjModel") -> list[int]:
    """Numbers of the bodies with a free joint."""
    import mujoco

    free = int(mujoco.mjtJoint.mjJNT_FREE)
    return [int(model.jnt_bodyid[j]) for j in range(model.njnt) if int(model.jnt_type[j]) == free]


def driving_bodies(model: "mujoco.MjModel") -> list[int]:
    """Those of the free bodies that carry a joint with a motor; the others are objects."""
    moved = {int(model.body_rootid[model.jnt_bodyid[j]]) for j in model.actuator_trnid[:, 0].tolist() if j >= 0}
    return [b for b in free_bodies(model) if b in moved]


def hinges_and_slides(model: "mujoco.MjModel") -> np.ndarray:
    """(joints,) numbers of the joints with one degree of freedom."""
    import mujoco

    return np.flatnonzero(np.isin(model.jnt_type, (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))))


def yaw_of(quat: np.ndarray) -> np.ndarray:
    """(...) rad in (-pi, pi] of quaternions (..., 4) as w, x, y, z."""
    w, x, y, z = np.moveaxis(quat, -1, 0)
    return np.asarray(np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))


def _at_rest(model: "mujoco.MjModel", v: int, name: str, path: str) -> "mujoco.MjData":
    import mujoco

    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, int(SETTLING / model.opt.timestep))
    mujoco.mj_forward(model, data)
    speed = float(np.abs(data.qvel[v : v + 6]).max())
    if not np.isfinite(speed) or speed > AT_REST:
        raise BadInput(
            f"without commands, {name} still moves at {speed:.3g} m/s or rad/s after {SETTLING} s",
            path,
            "add a ground plane to the model, and place the robot at rest on it",
        )
    return data


def _rolling(model: "mujoco.MjModel", data: "mujoco.MjData", q: int, v: int) -> np.ndarray:
    """(joints, 3): least squares of 'no contact point with friction slides on the ground', at rest."""
    import mujoco

    dofs = model.jnt_dofadr[hinges_and_slides(model)]
    rows = []
    for contact in data.contact:
        bodies = [int(model.geom_bodyid[g]) for g in contact.geom]
        moving = [b for b in bodies if model.body_weldid[b] != 0]
        if contact.dim < 3 or len(moving) != 1:
            continue
        jacobian = np.zeros((3, model.nv))
        mujoco.mj_jac(model, data, jacobian, None, contact.pos, moving[0])
        rows.append(contact.frame.reshape(3, 3)[1:] @ jacobian)
    if not rows:
        return np.zeros((len(dofs), 3))
    slide = np.concatenate(rows)
    turn = data.qpos[q + 3 : q + 7]
    c, s = np.cos(yaw_of(turn)), np.sin(yaw_of(turn))
    twist = np.zeros((model.nv, 3))  # the free joint's velocity for each of the three
    twist[v : v + 2, :2] = [[c, -s], [s, c]]
    twist[v + 3 : v + 6, 2] = _upward(turn)
    wheels = slide[:, dofs]
    wheels[np.abs(wheels) < ROLLS] = 0.0
    return np.asarray(-np.linalg.pinv(wheels) @ slide @ twist)


def _turned(angle: np.ndarray, quat: np.ndarray) -> np.ndarray:
    """(B, 4): quaternion (4,) turned about the vertical by angle (B,) rad."""
    c, s = np.cos(0.5 * angle), np.sin(0.5 * angle)
    w, x, y, z = quat
    return np.stack([c * w - s * z, c * x - s * y, c * y + s * x, c * z + s * w], axis=-1)


def _upward(quat: np.ndarray) -> np.ndarray:
    """(..., 3): the vertical in the axes of a body turned by quaternions (..., 4)."""
    w, x, y, z = np.moveaxis(quat, -1, 0)
    return np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], axis=-1)


def unwrapped(theta: np.ndarray, start: np.ndarray) -> np.ndarray:
    """(B, K + 1) headings without jumps that begin at start (B,), which may lie any number of turns away."""
    whole = np.unwrap(theta, axis=1)
    return np.asarray(whole + 2 * np.pi * np.round((start - whole[:, 0]) / (2 * np.pi))[:, None])
