"""The two-wheeled robot in MuJoCo."""

import numpy as np

from plants.mujoco_log import silence_mujoco
from plants.wheeled.engines.engine import SETTLE, Motion
from plants.wheeled.engines.geometry import WHEELS, Geometry
from plants.wheeled.engines.mjcf import mjcf


class MujocoEngine:
    """See Engine. `step` is the longest step, s."""

    def __init__(self, geometry: Geometry, step: float) -> None:
        import mujoco

        silence_mujoco()
        self._mujoco = mujoco
        self._model = mujoco.MjModel.from_xml_string(mjcf(geometry, step))
        self._data = mujoco.MjData(self._model)
        self._pairs = [self._model.pair(name).id for name in WHEELS]
        mujoco.mj_step(self._model, self._data, int(SETTLE / step) + 1)
        self._settled = self._data.qpos.copy()  # height, pitch and roll; nobody measures the wheels' angles

    def place(self, motion: Motion) -> None:
        mujoco, data = self._mujoco, self._data
        mujoco.mj_resetData(self._model, data)
        data.qpos[:] = self._settled
        data.qpos[:2] = motion.x, motion.y
        half = 0.5 * (motion.theta - _yaw(self._settled[3:7]))
        mujoco.mju_mulQuat(data.qpos[3:7], np.array([np.cos(half), 0.0, 0.0, np.sin(half)]), self._settled[3:7])
        data.qvel[:] = 0.0
        data.qvel[:2] = motion.vx, motion.vy
        data.qvel[5] = motion.yaw  # about the body's own z, which is upright but for a wheel's difference
        data.qvel[6:] = motion.wheel
        mujoco.mj_forward(self._model, data)

    def motion(self) -> Motion:
        q, v = self._data.qpos, self._data.qvel
        wheel = (float(v[6]), float(v[7]))
        return Motion(float(q[0]), float(q[1]), _yaw(q[3:7]), float(v[0]), float(v[1]), float(v[5]), wheel)

    def resist(self, torque: np.ndarray) -> None:
        self._model.dof_frictionloss[6:] = torque

    def grip(self, grip: np.ndarray) -> None:
        self._model.pair_friction[self._pairs, :2] = grip[:, None]

    def advance(self, set_point: np.ndarray, dt: float, steps: int) -> None:
        self._model.opt.timestep = dt
        self._data.ctrl[:] = set_point
        self._mujoco.mj_step(self._model, self._data, steps)

    def energy(self) -> float:
        """Kinetic and potential, J."""
        self._mujoco.mj_energyPos(self._model, self._data)
        self._mujoco.mj_energyVel(self._model, self._data)
        return float(self._data.energy.sum())

    def close(self) -> None:
        """MuJoCo's memory goes with the object."""


def _yaw(quat: np.ndarray) -> float:
    """rad, of a unit quaternion (w, x, y, z)."""
    w, x, y, z = (float(v) for v in quat)
    return float(np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))
