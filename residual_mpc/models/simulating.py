"""A robot that can be stepped as a simulator, effects included; optional for a robot."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np

from residual_mpc.models.robot_file import RobotFile
from residual_mpc.models.settings import Knob, Settings, Values

Readings = Mapping[str, np.ndarray]  # channel -> (rows,)


class Simulator(Protocol):
    """`rows` simulations side by side, stepped by one command period at a time.

    A simulation remembers what its effects remember: commands on their way, a motor's lag, the time since the run
    began, readings that have not arrived yet.
    """

    @property
    def rows(self) -> int: ...
    @property
    def period(self) -> float:
        """s that a command is held."""
        ...

    @property
    def actuators(self) -> tuple[str, ...]:
        """Order of a command."""
        ...

    @property
    def channels(self) -> tuple[str, ...]: ...

    def reset(
        self,
        start: Mapping[str, float | np.ndarray] | None = None,
        command: Any = None,
        where: np.ndarray | None = None,
    ) -> Readings:
        """Begin a run: at rest in the model's own start, but for the positions and velocities named in start (one value
        for all rows, or (rows,)). command (nu,) or (rows, nu): held for ever before; by default what holds the
        start posture of a position servo, else 0. where: mask (rows,), the others go on. Returns the readings."""
        ...

    def step(self, command: Any) -> Readings:
        """Hold command (nu,) or (rows, nu) for a period; what the sensors report at its end."""
        ...

    def save(self) -> Any:
        """Everything that the next steps depend on; for planners that try several futures."""
        ...

    def restore(self, saved: Any) -> None:
        """Go back to what `save` gave."""
        ...


@runtime_checkable
class Simulating(Protocol):
    def simulator(self, settings: Settings, rows: int, period: float) -> Simulator:
        """settings: one row. Raises ValueError for a period that is no whole number of the robot's steps."""
        ...


@dataclass(frozen=True)
class Mjcf:
    """text: an MJCF that holds the effects; approximated: those that it holds in another form, and which;
    left_out: those that it cannot hold, each with the reason; apart: the largest difference of a joint (rad or m)
    between it and the replay over a few motions of a second, with the effects as it holds them, at `points` samples;
    apart_from_all: the same with all effects as they were diagnosed."""

    text: str
    approximated: tuple[str, ...]
    left_out: tuple[str, ...]
    apart: float
    apart_from_all: float
    points: int


@dataclass(frozen=True)
class Exported:
    """text: a model in a form that has a place for fewer effects; approximated: those that it says in another form, and
    which; left_out: those that it cannot say, each with the reason; said: what it says, one row."""

    text: str
    approximated: tuple[str, ...]
    left_out: tuple[str, ...]
    said: Settings


Edit = tuple[str, str, str, int | None, float, float]  # kind, name, attribute, index (None: a scalar), base, slope


@dataclass(frozen=True)
class SysidParameter:
    """A number of a MuJoCo specification: each edit sets an attribute of an element to base + slope * value. low, high:
    its 95 % interval."""

    name: str
    value: float
    low: float
    high: float
    edits: tuple[Edit, ...]


@dataclass(frozen=True)
class SysidSet:
    """text: an MJCF with the parameters at their values; left_out: what neither holds, each with the reason; apart,
    apart_from_all, points: as in `Mjcf`."""

    text: str
    parameters: tuple[SysidParameter, ...]
    left_out: tuple[str, ...]
    apart: float
    apart_from_all: float
    points: int


@runtime_checkable
class WritesSysid(Protocol):
    def to_sysid(self, values: Values, intervals: Mapping[Knob, tuple[float, float]], folder: Path) -> SysidSet:
        """intervals: of the numbers that become parameters; folder: where the files will lie. Raises BadInput."""
        ...


@runtime_checkable
class WritesUrdf(Protocol):
    def to_urdf(self, settings: Settings, file: RobotFile, folder: Path) -> Exported:
        """settings: one row; file: the robot's, which names its URDF; folder: where the new one will lie. Raises
        BadInput for a robot whose model is no URDF."""
        ...

    def compare_urdf(self, made: Exported, settings: Settings, file: RobotFile, path: Path) -> tuple[float, float, int]:
        """Largest difference of a joint (rad or m) between the file at `path`, with the robot's own actuators, and the
        replay of what it says; the same from all effects; and at how many samples."""
        ...


@runtime_checkable
class WritesMjcf(Protocol):
    def to_mjcf(self, settings: Settings, folder: Path) -> Mjcf:
        """settings: one row; folder: where the file will lie, for the way to its meshes. Raises BadInput."""
        ...
