"""The arm in MuJoCo: position servos as spring and damper, the loop an equality constraint."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from plants.mujoco_log import silence_mujoco
from plants.scaler_arm.engines.mjcf import TIMESTEP, Options, mjcf
from plants.scaler_arm.kinematics.geometry import MOTORS, PASSIVE, SCALER, Arm
from plants.scaler_arm.kinematics.loop_closure import CHANNELS, joints_at
from plants.simulator import Plant, Reading

if TYPE_CHECKING:
    import mujoco


@dataclass(frozen=True)
class MujocoArm:
    """A simulator; see `plants.simulator.Simulator`. Commands are motor angles in rad."""

    arm: Arm = SCALER
    options: Options = field(default_factory=Options)
    name: str = "scaler_arm"
    actuators: tuple[str, ...] = MOTORS
    channels: tuple[str, ...] = CHANNELS

    def start(self, rng: np.random.Generator, at: Reading) -> Plant:
        """The arm at rest at `at` (motor channels; the passive joints follow). Nothing here is random."""
        import mujoco

        silence_mujoco()
        model = mujoco.MjModel.from_xml_string(mjcf(self.arm, self.options))
        return _Running(self, model, at)


class _Running:
    """A leaf: one MuJoCo simulation."""

    def __init__(self, what: MujocoArm, model: "mujoco.MjModel", at: Reading) -> None:
        import mujoco

        self._mj, self._model, self._data = mujoco, model, mujoco.MjData(model)
        names = MOTORS + PASSIVE
        self._qpos = np.array([int(model.joint(n).qposadr[0]) for n in names])
        self._dof = np.array([int(model.joint(n).dofadr[0]) for n in names])
        self._tool = int(model.site("tool").id)
        joints = joints_at(at, what.arm)
        self._data.qpos[self._qpos] = np.concatenate([joints.motors, joints.passive])
        self._data.qvel[self._dof] = np.concatenate([joints.motor_rates, joints.rates])
        mujoco.mj_forward(model, self._data)
        self._time = 0.0

    @property
    def time(self) -> float:
        return self._time

    def measure(self) -> Reading:
        return self.truth()

    def truth(self) -> Reading:
        data, n = self._data, len(MOTORS)
        self._mj.mj_kinematics(self._model, data)  # the step leaves the sites where they were before it
        values = (*data.qpos[self._qpos[:n]], *data.qvel[self._dof[:n]], *data.site_xpos[self._tool])
        return dict(zip(CHANNELS, (float(v) for v in values), strict=True))

    def step(self, command: np.ndarray, dt: float) -> None:
        if self._model.nu:
            self._data.ctrl[:] = command
        count = max(1, round(dt / TIMESTEP))
        self._model.opt.timestep = dt / count
        for _ in range(count):
            self._mj.mj_step(self._model, self._data)
        self._time += dt

    def close(self) -> None:
        del self._data, self._model
