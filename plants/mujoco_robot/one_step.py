"""One step of a batch that needs a word before it: servos' dead zones, what changes, servos that see the link."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from plants.mujoco_robot.gears import Feedback
from residual_mpc.effects.command import dead_zone_step
from residual_mpc.effects.ops import NUMPY
from residual_mpc.models.settings import Settings

if TYPE_CHECKING:
    from plants.mujoco_robot.robot import MujocoRobot


@dataclass(frozen=True, eq=False)
class OneStep:
    """between: see between_steps. servos: see feedback. zone (B, nu): width of the dead zone in a position servo's
    error, 0 for other actuators; None where there is none. dt: s, of the robot's step."""

    batch: Any
    robot: "MujocoRobot"
    between: Sequence[Any]
    servos: Feedback | None
    zone: np.ndarray | None
    dt: float

    def __call__(self, k: int, u: np.ndarray, force: np.ndarray) -> None:
        """Step number k under commands u (B, nu) that have gone through the chain; force (B, nu): the last step's."""
        robot, batch = self.robot, self.batch
        q, v, ctrl = batch.bind("qpos"), batch.bind("qvel"), batch.bind("ctrl")
        ctrl[:] = u
        if self.zone is not None:
            seen = q[:, robot.places[robot.driven]] if self.servos is None else self.servos.seen(robot, q)
            length = robot.model.actuator_gear[:, 0] * seen
            error, _ = dead_zone_step(NUMPY, {"width": self.zone}, (), u - length, self.dt)
            ctrl[:] = np.where(error == u - length, u, length + error)
        for update in self.between:
            update(k, v[:, robot.dofs], force)
        if self.servos is not None:
            self.servos.correct(ctrl, robot, q, v)
        batch.step(nstep=robot.substeps)


def error_zone(robot: "MujocoRobot", settings: Settings) -> np.ndarray | None:
    """(B, nu) the dead zones in position servos' errors; None where no effect or no such servo is."""
    zone = settings.effects.get("dead_zone")
    return None if zone is None or not robot.servo.any() else np.where(robot.servo, zone["width"], 0.0)
