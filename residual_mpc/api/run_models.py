"""The nominal model of each run: the variants of a robot file may give runs different models."""

from dataclasses import replace

from residual_mpc.api.robot import NominalRobot
from residual_mpc.models.load import load_robot as build_robot
from residual_mpc.models.protocol import Robot
from residual_mpc.models.robot_file import RobotFile, for_run


class RunModels:
    """Builds each different model once; runs with the same settings share one object."""

    def __init__(self, robot: NominalRobot) -> None:
        self._file = robot.file
        self._built: dict[str, Robot] = {_settings(robot.file): robot.model}

    def of(self, run: str) -> Robot:
        """The model of a run, by the run's name. Raises BadInput where its variant cannot be built."""
        file = for_run(self._file, run)
        key = _settings(file)
        if key not in self._built:
            self._built[key] = build_robot(file)
        return self._built[key]


def _settings(file: RobotFile) -> str:
    """All of a robot file that decides its model."""
    return repr(replace(file, noise={}, log={}, variants=()))
