"""The plant of a user's own robot: the robot in MuJoCo at a shorter step, and noise on its sensors."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from plants.mujoco_robot.simulation.plant import mujoco_plant
from plants.mujoco_robot.structure.compiled_robot import CompiledRobot
from residual_mpc.closed_loop.protocols import Plant, Reading, Simulator
from residual_mpc.errors import BadInput
from residual_mpc.models.protocol import Robot
from residual_mpc.models.settings import Values


def plant_of(robot: Robot, withheld: Values, period: float) -> Simulator:
    """A MuJoCo robot with effects that its model lacks. Raises BadInput for a robot that is not a MuJoCo model."""
    if not isinstance(robot, CompiledRobot):
        raise BadInput(
            f"{robot.name!r} is not a MuJoCo model and cannot be simulated as a plant", "`plant`",
            "name a factory with --plant package.module:factory",
        )  # fmt: skip
    return mujoco_plant(robot, withheld, period)


@dataclass(frozen=True, eq=False)
class NoisySensors:
    """A simulator with white noise of 1-sigma `sigma` on those channels; its other channels are not measured."""

    inner: Simulator
    sigma: Mapping[str, float]

    @property
    def actuators(self) -> tuple[str, ...]:
        return tuple(self.inner.actuators)

    @property
    def channels(self) -> tuple[str, ...]:
        return tuple(self.sigma)

    def start(self, rng: np.random.Generator, at: Reading) -> Plant:
        return _Noisy(self.inner.start(rng, at), self.sigma, rng)


class _Noisy:
    """A running plant with noise on its sensors."""

    def __init__(self, inner: Plant, sigma: Mapping[str, float], rng: np.random.Generator) -> None:
        self._inner, self._sigma, self._rng = inner, sigma, rng

    def measure(self) -> Reading:
        exact = self._inner.measure()
        noise = self._rng.standard_normal(len(self._sigma)).tolist()
        return {c: exact[c] + s * e for (c, s), e in zip(self._sigma.items(), noise, strict=True)}

    def truth(self) -> Reading:
        return self._inner.truth()

    def step(self, command: np.ndarray, dt: float) -> None:
        self._inner.step(command, dt)

    def close(self) -> None:
        self._inner.close()
