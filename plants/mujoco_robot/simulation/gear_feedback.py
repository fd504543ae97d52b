"""Which side of a gear the servos and the sensors see."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from plants.mujoco_robot.structure.compiled_robot import CompiledRobot


@dataclass(frozen=True, eq=False)
class Feedback:
    """Position servos that see the link, though they drive the motor.

    actuators (s,) numbers; gears (s,) places in Gears; ratio (B, s) damping over stiffness, s.
    """

    actuators: np.ndarray
    gears: np.ndarray
    ratio: np.ndarray

    def seen(self, robot: CompiledRobot, q: np.ndarray) -> np.ndarray:
        """(B, nu) positions of the actuators' joints, as their servos see them."""
        assert robot.gears is not None
        out = q[:, robot.places[robot.driven]].copy()
        out[:, self.actuators] += q[:, robot.gears.places[self.gears]]
        return out

    def correct(self, control: np.ndarray, robot: CompiledRobot, q: np.ndarray, v: np.ndarray) -> None:
        """Take what the link is ahead of the motor from the commands (B, nu), in place: kp (u - q link) - kv v link."""
        assert robot.gears is not None
        gear = robot.model.actuator_gear[self.actuators, 0]
        ahead, rate = q[:, robot.gears.places[self.gears]], v[:, robot.gears.dofs[self.gears]]
        control[:, self.actuators] -= gear * (ahead + self.ratio * rate)


def link_servos(robot: CompiledRobot) -> np.ndarray:
    """(s,) numbers of the position servos at split joints that see the link."""
    if robot.gears is None or robot.servo_feedback != "link":
        return np.zeros(0, dtype=int)
    return np.flatnonzero(robot.servo & np.isin(robot.driven, robot.gears.joints))


def feedback(batch: Any, robot: CompiledRobot) -> Feedback | None:
    """The feedback of link_servos; None where there is none. To be asked before any actuator is switched off."""
    servos = link_servos(robot)
    if robot.gears is None or not len(servos):
        return None
    bias = batch.expand("actuator_biasprm")[:, servos]
    order = {j: i for i, j in enumerate(robot.gears.joints.tolist())}
    at = np.array([order[j] for j in robot.driven[servos].tolist()])
    return Feedback(servos, at, bias[:, :, 2] / bias[:, :, 1])


def on_link_side(robot: CompiledRobot, q: np.ndarray, v: np.ndarray) -> None:
    """Make the motors' entries in positions (..., nq) and velocities (..., nv) those of the logged side, in place."""
    gears = robot.gears
    if gears is None or robot.position_sensor != "link":
        return
    q[..., robot.places[gears.joints]] += q[..., gears.places]
    v[..., robot.dofs[gears.joints]] += v[..., gears.dofs]
