"""What is driven: the robot in MuJoCo at a finer step, or whatever the user's own factory makes."""

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
    """A MuJoCo robot with effects that its model lacks. Raises BadInput for a robot that is none."""
    if not isinstance(robot, CompiledRobot):
        raise BadInput(
            f"{robot.name!r} is no MuJoCo model, so there is nothing to drive", "--plant",
            "name a factory with --plant package.module:factory",
        )  # fmt: skip
    return mujoco_plant(robot, withheld, period)


@dataclass(frozen=True, eq=False)
class Measured:
    """A simulator whose channels of `sigma` carry white noise of that size; the tool is for scoring alone."""

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
    """A leaf: the plant and its sensors' noise."""

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

