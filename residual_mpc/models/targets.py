"""The targets that each effect has on a robot."""

from residual_mpc.effects.laws import CARRIERS, kind_of
from residual_mpc.effects.library import HOSTED
from residual_mpc.models.protocol import Robot


def targets_of(robot: Robot, effect: str) -> tuple[str, ...]:
    """The targets of an effect; those of a law of a logged column are its carrier's, of which alone a robot knows."""
    kind = kind_of(effect)
    return robot.slots(CARRIERS[kind.of].effect if kind is not None and kind.on == "logged" else effect)


class Targets(dict[str, tuple[str, ...]]):
    """Effect -> its targets on a robot. The effects of the library are listed; those of any other name are found."""

    def __init__(self, robot: Robot) -> None:
        super().__init__({effect.name: robot.slots(effect.name) for effect in HOSTED})
        self._robot = robot

    def __missing__(self, effect: str) -> tuple[str, ...]:
        return targets_of(self._robot, effect)
