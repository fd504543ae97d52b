"""A robot that predicts otherwise than another, and is like it in all else."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from residual_mpc.models.protocol import Drive, Merging, Robot, State
from residual_mpc.models.settings import Settings

Replay = Callable[[Robot, Mapping[str, np.ndarray], Drive, Settings, tuple[str, ...]], Mapping[str, np.ndarray]]


@runtime_checkable
class Wrapping(Protocol):
    @property
    def wraps(self) -> Robot:
        """The robot whose optional members hold for this one, which predicts otherwise."""
        ...


def innermost(robot: Robot) -> Robot:
    """The robot whose optional members hold for this one."""
    while isinstance(robot, Wrapping):
        robot = robot.wraps
    return robot


@dataclass(frozen=True, eq=False)
class Wrapped:
    """`base` with another replay: replayed(base, start, drive, settings, wanted), see `Robot.replay`."""

    base: Robot
    replayed: Replay

    @property
    def wraps(self) -> Robot:
        """See Wrapping."""
        return self.base

    @property
    def name(self) -> str:
        return self.base.name

    @property
    def actuators(self) -> tuple[str, ...]:
        return self.base.actuators

    @property
    def command_kinds(self) -> tuple[str, ...]:
        return self.base.command_kinds

    @property
    def states(self) -> tuple[State, ...]:
        return self.base.states

    @property
    def channels(self) -> tuple[str, ...]:
        return self.base.channels

    @property
    def step(self) -> float | None:
        return self.base.step

    def slots(self, effect: str) -> tuple[str, ...]:
        return self.base.slots(effect)

    def bounds(self, effect: str, parameter: str, slot: str | None) -> tuple[float, float]:
        return self.base.bounds(effect, parameter, slot)

    def reference(self, kind: str, slot: str | None) -> float:
        return self.base.reference(kind, slot)

    def nominal(self) -> Mapping[str, float]:
        return self.base.nominal()

    def merged(self, others: "Sequence[Robot]") -> "Wrapped | None":
        """This robot and others as one, where all have the same replay and their bases can be merged."""
        alike = [o.base for o in others if isinstance(o, Wrapped) and o.replayed is self.replayed]
        if not isinstance(self.base, Merging) or len(alike) < len(others):
            return None
        whole = self.base.merged(alike)
        return None if whole is None else Wrapped(whole, self.replayed)

    def replay(
        self, start: Mapping[str, np.ndarray], drive: Drive, settings: Settings, wanted: tuple[str, ...]
    ) -> Mapping[str, np.ndarray]:
        return self.replayed(self.base, start, drive, settings, wanted)
