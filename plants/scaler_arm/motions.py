"""The paper's two motions of the arm, drawn by the tool point with the gripper held as it is at home.

A motion is a frozen record; `tool_path` says where the tool is to be at any times, `references` where the motors.
"""

from dataclasses import dataclass

import numpy as np

from plants.scaler_arm.kinematics.forward import forward_kinematics
from plants.scaler_arm.kinematics.geometry import HOME, SCALER, Arm
from plants.scaler_arm.kinematics.inverse import inverse_kinematics
from residual_mpc.errors import BadInput


@dataclass(frozen=True)
class CircleWithLine:
    """Trajectory A: a circle in x and y, then a straight line through its centre and back along it; then again.

    radius m; period s of the circle; line s of the way across and back. It begins and ends every part at rest, on the
    circle's point nearest to the mount.
    """

    radius: float = 0.04
    period: float = 8.0
    line: float = 8.0

    def __post_init__(self) -> None:
        _positive("a circle with a line", self.radius, self.period, self.line)

    def offset(self, t: np.ndarray) -> np.ndarray:
        """(n, 3) m from the circle's centre at times t (n,) s."""
        t = np.mod(t, self.period + self.line)
        turn = 2 * np.pi * _smooth(t / self.period)
        there_and_back = 0.5 * (1.0 - np.cos(2 * np.pi * _smooth((t - self.period) / self.line)))
        round_it = t < self.period
        x = np.where(round_it, -np.cos(turn), 2.0 * there_and_back - 1.0)
        y = np.where(round_it, -np.sin(turn), 0.0)
        return self.radius * np.stack([x, y, np.zeros_like(t)], axis=-1)


@dataclass(frozen=True)
class CircleWithHeight:
    """Trajectory B: a circle in x and y while z goes up and down.

    radius m and period s of the circle; height m, half the way between top and bottom; waves up and down in a turn. It
    begins at full speed: start the arm there, or let it catch up.
    """

    radius: float = 0.04
    period: float = 8.0
    height: float = 0.02
    waves: int = 2

    def __post_init__(self) -> None:
        _positive("a circle with height", self.radius, self.period, self.height, self.waves)

    def offset(self, t: np.ndarray) -> np.ndarray:
        """(n, 3) m from the circle's centre at times t (n,) s."""
        turn = 2 * np.pi * t / self.period
        rise = self.height * np.sin(self.waves * turn)
        return np.stack([-self.radius * np.cos(turn), -self.radius * np.sin(turn), rise], axis=-1)


Motion = CircleWithLine | CircleWithHeight


def tool_path(motion: Motion, t: np.ndarray, arm: Arm = SCALER) -> np.ndarray:
    """(n, 3) m: the tool point at times t (n,) s; the motion's centre is where the tool is at home."""
    centre, _ = forward_kinematics(np.array(HOME), arm)
    return np.asarray(centre + motion.offset(np.asarray(t, dtype=np.float64)))


def references(motion: Motion, t: np.ndarray, arm: Arm = SCALER) -> np.ndarray:
    """(n, 6) rad: motor angles that draw it. Raises Unreachable where the motion leaves the joint limits."""
    _, frame = forward_kinematics(np.array(HOME), arm)
    return inverse_kinematics(tool_path(motion, t, arm), np.broadcast_to(frame, (len(t), 3, 3)), arm)


def _smooth(part: np.ndarray) -> np.ndarray:
    """From 0 to 1 with no speed and no acceleration at either end; part 0 to 1, clipped."""
    s = np.clip(part, 0.0, 1.0)
    return np.asarray(s**3 * (10.0 - 15.0 * s + 6.0 * s * s))


def _positive(what: str, *sizes: float) -> None:
    if not all(np.isfinite(s) and s > 0 for s in sizes):
        raise BadInput(f"{what} must be positive, got {sizes}", "motion")
