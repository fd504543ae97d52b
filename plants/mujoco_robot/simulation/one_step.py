"""One step of a batch that needs a word before it: servos' dead zones, what changes, servos that see the link."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from plants.mujoco_robot.simulation.gear_feedback import Feedback
from plants.mujoco_robot.simulation.servo_integral import ServoIntegrals
from plants.mujoco_robot.structure.compiled_robot import CompiledRobot
from residual_mpc.effects.effect import Effect, Values
from residual_mpc.effects.ops import NUMPY


@dataclass(frozen=True, eq=False)
class OneStep:
    """between: see between_steps. servos: see feedback. errors: what acts on position servos' errors, see on_errors.
    integrals: what their integral parts add, None where none has one. dt: s, of the robot's step. rows: indices
    of the rows to step, None for all."""

    batch: Any
    robot: CompiledRobot
    between: Sequence[Any]
    servos: Feedback | None
    errors: Sequence[tuple[Effect, Values]]
    dt: float
    integrals: ServoIntegrals | None = None
    rows: np.ndarray | None = None

    @cached_property
    def _state(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Live positions (B, nq), velocities (B, nv), controls (B, nu): to bind them takes as long as to use them."""
        return self.batch.bind("qpos"), self.batch.bind("qvel"), self.batch.bind("ctrl")

    @cached_property
    def _driven(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(nu,) places of the actuators' joints among the positions and among the velocities, and their gear ratios."""
        robot = self.robot
        return robot.places[robot.driven], robot.dofs[robot.driven], robot.model.actuator_gear[:, 0].copy()

    def __call__(self, k: int, u: np.ndarray, force: np.ndarray) -> None:
        """Step number k under commands u (B, nu) that have gone through the chain; force (B, nu): the last step's."""
        robot, batch = self.robot, self.batch
        q, v, ctrl = self._state
        ctrl[:] = u
        if self.errors or self.integrals is not None:
            places, dofs, gear = self._driven
            length = gear * (q[:, places] if self.servos is None else self.servos.seen(robot, q))
            if self.integrals is not None:
                u = self.integrals.through(k, u, length, gear * v[:, dofs], self.dt)
                ctrl[:] = u
            error = u - length
            for effect, p in self.errors:
                assert effect.step is not None
                error, _ = effect.step(NUMPY, p, (), error, self.dt)
            ctrl[:] = np.where(error == u - length, u, length + error)
        if self.between:
            speed = v[:, robot.dofs]
            for update in self.between:
                update(k, speed, force)
        if self.servos is not None:
            self.servos.correct(ctrl, robot, q, v)
        batch.step(self.rows, nstep=robot.substeps)
