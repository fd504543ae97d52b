"""What a physics engine has to do for the two-wheeled robot, whichever it is."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from plants.simulator import Reading

CHANNELS = (
    "pose.x",
    "pose.y",
    "pose.theta",
    "twist.x",
    "twist.y",
    "twist.theta",
    "velocity.left",
    "velocity.right",
)
SETTLE = 0.3  # s at rest, after which the contacts carry the robot


@dataclass(frozen=True)
class Motion:
    """State of the robot that matters to its path; all but this starts at rest.

    x, y m and theta rad (wrapped) of the robot's frame in the world; vx, vy m/s and yaw rad/s in the world; wheel (2,)
    rad/s, left and right.
    """

    x: float = 0.0
    y: float = 0.0
    theta: float = 0.0
    vx: float = 0.0
    vy: float = 0.0
    yaw: float = 0.0
    wheel: tuple[float, float] = (0.0, 0.0)

    def reading(self) -> Reading:
        values = (self.x, self.y, self.theta, self.vx, self.vy, self.yaw, *self.wheel)
        return dict(zip(CHANNELS, values, strict=True))


def motion_of(at: Reading) -> Motion:
    """From run-log channels; those that are not named are 0."""
    x, y, theta, vx, vy, yaw, left, right = (float(at.get(c, 0.0)) for c in CHANNELS)
    return Motion(x, y, theta, vx, vy, yaw, (left, right))


class Engine(Protocol):
    """A leaf that owns the engine's handle. `place` before anything else."""

    def place(self, motion: Motion) -> None:
        """Set the state, settled on the ground; whatever happened before is forgotten."""
        ...

    def motion(self) -> Motion: ...

    def resist(self, torque: np.ndarray) -> None:
        """Dry friction (2,) N m against each wheel's motion from now on."""
        ...

    def grip(self, grip: np.ndarray) -> None:
        """Coulomb's coefficient (2,) between each tyre and the ground from now on."""
        ...

    def advance(self, set_point: np.ndarray, dt: float, steps: int) -> None:
        """`steps` steps of dt s, the motors' set points (2,) rad/s held."""
        ...

    def close(self) -> None: ...
