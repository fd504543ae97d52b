"""What a robot may offer for its picture, and the camera that all pictures share. Each protocol is optional.

A robot with `pose.x` and `pose.y` is drawn from above, with its `outline` where it has one. Another is drawn from the
side: by its own `Rendering`, else as the lines of its `skeleton`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from residual_mpc.models.protocol import Robot
from residual_mpc.models.wrapped import innermost

Motion = Mapping[str, np.ndarray]  # position channel of every state -> (F,) channel unit, at F instants
Size = tuple[int, int]  # width, height, px


class NoRenderer(Exception):
    """No renderer works on this machine; the message says what was tried."""


@dataclass(frozen=True)
class Camera:
    """An orthographic view. target (3,) m: what is in the middle; azimuth, elevation: of the viewing direction, degrees
    (elevation -90 looks down); height: m from the lower to the upper edge."""

    target: tuple[float, float, float]
    azimuth: float
    elevation: float
    height: float

    @property
    def axes(self) -> np.ndarray:
        """(3, 3) rows: right, up and the viewing direction, unit vectors in the world."""
        a, e = np.radians(self.azimuth), np.radians(self.elevation)
        forward = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
        right = np.array([np.sin(a), -np.cos(a), 0.0])
        return np.stack([right, np.cross(right, forward), forward])

    def project(self, points: np.ndarray, size: Size) -> np.ndarray:
        """(..., 2) px from the upper left corner, of points (..., 3) m."""
        width, height = size
        seen = (np.asarray(points) - np.array(self.target)) @ self.axes[:2].T
        scale = height / self.height
        return np.asarray(np.stack([0.5 * width + scale * seen[..., 0], 0.5 * height - scale * seen[..., 1]], axis=-1))


@runtime_checkable
class Skeletal(Protocol):
    def skeleton(self, motion: Motion) -> np.ndarray:
        """(F, S, 2, 3) m: the robot as S line segments at each instant; the last one ends at the tool."""
        ...


@runtime_checkable
class Rendering(Protocol):
    def shade(self, motions: Sequence[Motion], camera: Camera, size: Size) -> np.ndarray:
        """(N, F, height, width) uint8: brightness of the robot in each of N motions; 0 where it is not.

        Raises NoRenderer where this machine has none.
        """
        ...


@runtime_checkable
class Outlined(Protocol):
    @property
    def outline(self) -> np.ndarray | None:
        """(P, 2) m: the robot's outline from above in its own frame, x forward, without the first point again; None of
        a robot that has none."""
        ...


def skeleton(robot: Robot, motion: Motion) -> np.ndarray | None:
    """See Skeletal; None of a robot that has none."""
    robot = innermost(robot)
    return robot.skeleton(motion) if isinstance(robot, Skeletal) else None


def shade(robot: Robot, motions: Sequence[Motion], camera: Camera, size: Size) -> np.ndarray:
    """See Rendering. Raises NoRenderer, also where the robot has no renderer."""
    robot = innermost(robot)
    if not isinstance(robot, Rendering):
        raise NoRenderer(f"{robot.name} has no renderer")
    return robot.shade(motions, camera, size)


def outline(robot: Robot) -> np.ndarray | None:
    """See Outlined; None of a robot that has none."""
    robot = innermost(robot)
    return robot.outline if isinstance(robot, Outlined) else None
