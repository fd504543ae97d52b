"""What a closed-loop experiment is: a robot that is not what its model says, and a path."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from residual_mpc.closed_loop.protocols import Reading, Reference, Simulator
    from scenarios.closed_loop.robot_setup import RobotSetup

Withheld = Mapping[tuple[str, str | None, str], float]  # (effect, target, parameter) -> true value


@dataclass(frozen=True)
class ClosedLoopTask:
    """A robot in a physics engine, under the controllers of the contract.

    setup: the robot as its model has it. simulator: makes the real one (in `plant`'s engine). withheld: what the oracle
    knows of it. reference: makes the path; where the robot's poses are not what is tracked, it has a `begin()` too, the
    poses by channel at its start. training_motions: those that the nominal controller drives for the log that is
    diagnosed, with their seconds. limits: soft ones, (channel, lower, upper) in m or rad. speed: m/s, about as fast as
    the path.
    """

    name: str
    summary: str
    plant: str
    setup: "Callable[[], RobotSetup]"
    simulator: "Callable[[], Simulator]"
    withheld: Withheld
    reference: "Callable[[], Reference]"
    seconds: float = 20.0
    dt: float = 0.05
    limits: tuple[tuple[str, float, float], ...] = ()
    speed: float = 0.2
    training_motions: "tuple[tuple[Callable[[], Reference], float], ...]" = field(default=())

    def shorter(self, seconds: float) -> "ClosedLoopTask":
        """The same experiment, driven for less long."""
        return replace(self, seconds=seconds)


def start_reading(reference: "Reference") -> "Reading | None":
    """Where a robot begins; None: at the path's first pose."""
    begin = getattr(reference, "begin", None)
    return None if begin is None else begin()
