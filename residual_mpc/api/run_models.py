"""The nominal model of each run: the variants of a robot file may give runs different models."""

from dataclasses import replace

from residual_mpc.api.robot import NominalRobot
from residual_mpc.models.load import load_robot as build_robot
from residual_mpc.models.protocol import Robot
from residual_mpc.models.refuted import NOTHING, Refuted
from residual_mpc.models.robot_file import RobotFile, for_run


class RunModels:
    """Builds each different model once; runs with the same settings share one object.

    refuted: what of the models the runs refute, which they are without.
    """

    def __init__(self, robot: NominalRobot, refuted: Refuted = NOTHING) -> None:
        self._file, self._refuted = robot.file, refuted
        self._built: dict[str, Robot] = {_settings(robot.file): refuted.without(robot.model)}

    def of(self, run: str) -> Robot:
        """The model of a run, by the run's name. Raises BadInput where its variant cannot be built."""
        file = for_run(self._file, run)
        key = _settings(file)
        if key not in self._built:
            self._built[key] = self._refuted.without(build_robot(file))
        return self._built[key]


def _settings(file: RobotFile) -> str:
    """All of a robot file that decides its model."""
    return repr(replace(file, noise={}, log={}, variants=()))
