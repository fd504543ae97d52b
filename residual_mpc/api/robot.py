"""A robot as a user names it: its file, and the nominal model that the file describes."""

import sys
from dataclasses import dataclass
from pathlib import Path

from residual_mpc.api.display import brief, page
from residual_mpc.models.load import load_robot as build_robot
from residual_mpc.models.protocol import Robot
from residual_mpc.models.robot_file import RobotFile, read_robot_file


@dataclass(frozen=True, eq=False)
class NominalRobot:
    """A robot file with its nominal model. given: the file, or the name of a built-in robot, as the user gave it."""

    file: RobotFile
    model: Robot
    given: str

    @property
    def name(self) -> str:
        return self.file.name

    def lines(self) -> list[str]:
        """The robot in words."""
        model = self.model
        return [
            f"{self.name} ({self.file.plant})",
            f"  commands: {', '.join(f'{a} ({k})' for a, k in zip(model.actuators, model.command_kinds, strict=True))}",
            f"  channels: {', '.join(model.channels)}",
        ]

    def __str__(self) -> str:
        return "\n".join(self.lines())

    def __repr__(self) -> str:
        return brief(self, str(self))

    def _repr_html_(self) -> str:
        return page(self.lines())


def load_robot(source: str | Path) -> NominalRobot:
    """A robot with its nominal model.

    Args:
        source: robot file (TOML), MJCF or URDF file, or the name of a built-in robot. A URDF has no actuators: only a
            robot file can add them.

    Raises:
        BadInput: a file that is missing or cannot be used, or a model that does not compile.
    """
    allow_user_modules()
    file = read_robot_file(source)
    return NominalRobot(file, build_robot(file), str(source))


def allow_user_modules() -> None:
    """A user's plant `package.module:factory` may live in the folder they stand in."""
    if "" not in sys.path and str(Path.cwd()) not in sys.path:
        sys.path.insert(0, str(Path.cwd()))
