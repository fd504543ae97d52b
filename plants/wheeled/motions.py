"""What the wheeled robot is asked to do: the paper's motions and three of our own, as frozen records.

A motion gives the body's wanted speed and yaw rate over time; `path` integrates them to the reference pose, `policy`
turns them into wheel speeds by the paper's equation wheel_prop, inverted.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from plants.simulator import Policy, Reading
from plants.wheeled.engines.geometry import Geometry

Twist = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]  # t (n,) s -> forward m/s, yaw rate rad/s, (n,) each


@dataclass(frozen=True)
class Reference:
    """A motion by name, with what it is held against in the paper's figure."""

    name: str
    twist: Twist
    period: float  # s, after which it repeats

    def path(self, t: np.ndarray, start: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> np.ndarray:
        """(n, 3) of x m, y m, theta rad at increasing t (n,) s from 0 on, by the midpoint rule in steps under 5 ms."""
        fine = max(1, int(np.ceil(float(np.max(np.diff(t, prepend=0.0))) / 0.005)))
        ends = np.concatenate([[0.0], t])
        share = np.arange(fine) / fine
        grid = np.append((ends[:-1, None] + np.diff(ends)[:, None] * share).ravel(), ends[-1])
        v, w = self.twist(0.5 * (grid[1:] + grid[:-1]))
        h = np.diff(grid)
        theta = start[2] + np.append(0.0, np.cumsum(w * h))
        middle = 0.5 * (theta[1:] + theta[:-1])
        x = start[0] + np.append(0.0, np.cumsum(v * np.cos(middle) * h))
        y = start[1] + np.append(0.0, np.cumsum(v * np.sin(middle) * h))
        return np.stack([x, y, theta], axis=1)[fine::fine]


def spin_in_place(rate: float = 2.0, period: float = 8.0) -> Reference:
    """Turns on the spot whose rate goes from -rate to rate rad/s and back (the paper's case A: 2 rad/s)."""
    return Reference("spin", lambda t: (np.zeros_like(t), rate * np.sin(2 * np.pi * t / period)), period)


def back_and_forth(speed: float = 0.2, period: float = 8.0) -> Reference:
    """Straight on x, from -speed to speed m/s and back (the paper's case B: 0.2 m/s)."""
    return Reference("back_and_forth", lambda t: (speed * np.sin(2 * np.pi * t / period), np.zeros_like(t)), period)


def changing_yaw_rate(rate: float = 1.0, step: float = 4.0) -> Reference:
    """Turns on the spot at held rates, both ways (the paper's cases C and D change the angular velocity alone)."""
    levels = rate * np.array([1.0, -1.0, 0.5, -0.5])

    def twist(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.zeros_like(t), levels[(t / step).astype(int) % 4]

    return Reference("changing_yaw_rate", twist, 4 * step)


def constant_yaw_rate(rate: float = 1.0, speed: float = 0.0) -> Reference:
    """One yaw rate for ever (the paper's case E): a spin, or a circle of speed / rate m where it also drives."""

    def twist(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.full_like(t, speed), np.full_like(t, rate)

    return Reference("constant_yaw_rate", twist, 2 * np.pi / abs(rate))


def figure_eight(width: float = 1.0, period: float = 20.0) -> Reference:
    """The lemniscate x = a sin(s), y = a sin(s) cos(s), `width` = 2 a m wide, turned so that it starts along x.

    Speed and yaw rate follow from the curve's derivatives, so that its curvature is met exactly.
    """
    a, k = 0.5 * width, 2 * np.pi / period

    def twist(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        s = k * t
        dx, dy = a * k * np.cos(s), a * k * np.cos(2 * s)
        ddx, ddy = -a * k * k * np.sin(s), -2 * a * k * k * np.sin(2 * s)
        square = dx**2 + dy**2
        return np.sqrt(square), (dx * ddy - dy * ddx) / square

    return Reference("figure_eight", twist, period)


def route(side: float = 0.8, speed: float = 0.15, corner: float = 0.2) -> Reference:
    """Once around a square with round corners of radius `corner` m, at one speed, as a delivery robot drives."""
    straight, turn = (side - 2 * corner) / speed, 0.5 * np.pi * corner / speed
    leg = straight + turn

    def twist(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        turning = np.mod(t, leg) >= straight
        return np.full_like(t, speed), np.where(turning, speed / corner, 0.0)

    return Reference("route", twist, 4 * leg)


PAPER = (spin_in_place(), back_and_forth(), changing_yaw_rate(), constant_yaw_rate())
MOTIONS = (*PAPER, figure_eight(), route())


def wheel_speeds(forward: np.ndarray, yaw: np.ndarray, radius: float, track: float) -> np.ndarray:
    """(..., 2) rad/s, left and right, that give forward m/s and yaw rad/s: wheel_prop inverted."""
    half = 0.5 * track * np.asarray(yaw)
    return np.stack([np.asarray(forward) - half, np.asarray(forward) + half], axis=-1) / radius


def policy(reference: Reference, geometry: Geometry, period: float, ramp: float = 1.0) -> Policy:
    """Open loop: the wheel speeds of the reference, by nominal figures, for a command held for `period` s.

    The command is the reference's in the middle of its hold, so that it lags nowhere. A robot that stands cannot jump:
    over the first `ramp` s the reference's own time speeds up from rest, which leaves its path as it is and makes it
    half of `ramp` late.
    """

    def send(t: float, reading: Reading) -> np.ndarray:
        middle = t + 0.5 * period
        pace = min(1.0, middle / ramp) if ramp > 0 else 1.0
        v, w = reference.twist(np.array([_own_time(middle, ramp)]))
        return pace * wheel_speeds(v[0], w[0], geometry.left.radius, geometry.track)

    return send


def _own_time(t: float, ramp: float) -> float:
    return t - 0.5 * ramp if t >= ramp else 0.5 * t * t / ramp
