"""The targets that each effect has on a robot, asked for when they are needed."""

from residual_mpc.effects.library import HOSTED
from residual_mpc.models.protocol import Robot


class Targets(dict[str, tuple[str, ...]]):
    """Effect -> its targets on a robot; those of the library are listed, that of any other name is found."""

    def __init__(self, robot: Robot) -> None:
        super().__init__({effect.name: robot.slots(effect.name) for effect in HOSTED})
        self._robot = robot

    def __missing__(self, effect: str) -> tuple[str, ...]:
        return self._robot.slots(effect)
