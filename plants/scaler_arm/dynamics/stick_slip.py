"""Stick and slip of a geared servo: a joint at rest bears some error before it breaks away, and jumps when it does."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Sticking:
    """One law for all motors, each (n,) or a number.

    stick: rad of error that a joint at rest bears. slip: rad that it stays behind while it moves, less than stick.
    slowest: rad/s of the command below which a moving joint comes to rest again. Zeros do nothing.
    """

    stick: float | np.ndarray = 0.0
    slip: float | np.ndarray = 0.0
    slowest: float = 0.0

    def __post_init__(self) -> None:
        if not (np.all(np.asarray(self.slip) >= 0) and np.all(np.asarray(self.stick) >= self.slip)):
            raise ValueError(f"slip and stick must satisfy 0 <= slip <= stick, got {self.slip} and {self.stick}")


@dataclass(frozen=True)
class Stuck:
    """What sticking remembers, each (n,): the target that the joint rests or moves at rad, the command before it rad,
    and the way it moves (-1, 1, or 0 at rest).
    """

    target: np.ndarray
    command: np.ndarray
    way: np.ndarray


def sticking_start(command: np.ndarray) -> Stuck:
    """At rest where command (n,) rad holds it."""
    return Stuck(command.copy(), command.copy(), np.zeros_like(command))


def sticking_step(law: Sticking, x: Stuck, command: np.ndarray, dt: float) -> tuple[np.ndarray, Stuck]:
    """(the target (n,) rad that the servo acts on, memory) for command (n,) rad after dt s."""
    error = command - x.target
    breaks = (x.way != np.sign(error)) & (np.abs(error) > law.stick)  # from rest, or the other way
    way = np.where(breaks, np.sign(error), x.way)
    # a joint that moves follows, `slip` behind; it stays where it is when the command turns back
    ahead = way * (command - way * law.slip - x.target) > 0
    target = np.where((way != 0) & ahead, command - way * law.slip, x.target)
    rests = np.abs(command - x.command) <= law.slowest * dt
    way = np.where(rests | ((way != 0) & ~ahead), 0.0, way)
    return target, Stuck(target, command.copy(), way)
