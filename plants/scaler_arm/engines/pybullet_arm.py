"""The arm in PyBullet, as in the paper: in-built position control, the loop closed by the solver, steps of 0.01 s."""

from dataclasses import dataclass

import numpy as np

from plants.scaler_arm.engines.pybullet_world import World
from plants.scaler_arm.kinematics.geometry import MOTORS, SCALER, Arm
from plants.scaler_arm.kinematics.loop_closure import CHANNELS, joints_at
from plants.simulator import Plant, Reading


@dataclass(frozen=True)
class PybulletArm:
    """A simulator; see `plants.simulator.Simulator`. Commands are motor angles in rad.

    timestep: s, the longest step that the engine takes; the paper's by default.
    """

    arm: Arm = SCALER
    timestep: float = 0.01
    friction: bool = True
    gravity: bool = True
    motors: bool = True
    name: str = "scaler_arm"
    actuators: tuple[str, ...] = MOTORS
    channels: tuple[str, ...] = CHANNELS

    def start(self, rng: np.random.Generator, at: Reading) -> Plant:
        """The arm at rest at `at` (motor channels; the passive joints follow). Nothing here is random.

        Raises BadInput where PyBullet is not installed.
        """
        return _Running(self, at)


class _Running:
    """A leaf: one PyBullet world."""

    def __init__(self, what: PybulletArm, at: Reading) -> None:
        self._what = what
        joints = joints_at(at, what.arm)
        self._world = World(what.arm, what.friction, what.gravity)
        self._world.put(joints)
        self._time = 0.0

    @property
    def time(self) -> float:
        return self._time

    def measure(self) -> Reading:
        return self.truth()

    def truth(self) -> Reading:
        angles, rates = self._world.joints()
        n = len(MOTORS)
        values = (*angles[:n], *rates[:n], *self._world.point("tool"))
        return dict(zip(CHANNELS, (float(v) for v in values), strict=True))

    def step(self, command: np.ndarray, dt: float) -> None:
        count = max(1, int(np.ceil(dt / self._what.timestep - 1e-9)))
        if self._what.motors:
            self._world.servo(command, dt / count)
        else:
            self._world.set_step(dt / count)
        for _ in range(count):
            self._world.step()
        self._time += dt

    def close(self) -> None:
        self._world.close()
