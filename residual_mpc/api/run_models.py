"""The nominal model of each run: the variants of a robot file may give runs different models."""

from collections.abc import Sequence
from dataclasses import replace

from residual_mpc.api.robot import NominalRobot
from residual_mpc.logs.audit.ranges import COMMAND, JOINT, PassedRange, ranges_by_name
from residual_mpc.models import optional
from residual_mpc.models.load import load_robot as build_robot
from residual_mpc.models.protocol import Robot
from residual_mpc.models.robot_file import RobotFile, for_run


class RunModels:
    """Builds each different model once; runs with the same settings share one object.

    passed: ranges that the robot went beyond; the models are without these ends.
    """

    def __init__(self, robot: NominalRobot, passed: Sequence[PassedRange] = ()) -> None:
        self._file = robot.file
        self._joints, self._commands = (ranges_by_name(passed, of) for of in (JOINT, COMMAND))
        self._built: dict[str, Robot] = {_settings(robot.file): self._widened(robot.model)}

    def of(self, run: str) -> Robot:
        """The model of a run, by the run's name. Raises BadInput where its variant cannot be built."""
        file = for_run(self._file, run)
        key = _settings(file)
        if key not in self._built:
            self._built[key] = self._widened(build_robot(file))
        return self._built[key]

    def _widened(self, robot: Robot) -> Robot:
        none = not (self._joints or self._commands)
        return robot if none else optional.with_ranges(robot, self._joints, self._commands)


def _settings(file: RobotFile) -> str:
    """All of a robot file that decides its model."""
    return repr(replace(file, noise={}, log={}, variants=()))
