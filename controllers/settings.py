"""What tunes the controllers: weights, limits, and how the quadratic program is solved."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

Solver = Literal["osqp", "daqp"]


@dataclass(frozen=True)
class Weights:
    """Cost a step: error' Q error + change' S change + command' R command, over deviations in the units below.

    error: a channel's error that costs 1 (its unit), in the order of what the model tracks; for a planar robot along,
    across and heading. command, change: the deviation from the reference's command, and the change from one step to the
    next, that cost 1 (actuator unit), of all commands or one each.
    """

    error: tuple[float, ...] = (0.05, 0.05, 0.2)  # m, m, rad
    command: float | tuple[float, ...] = 200.0  # rad/s
    change: float | tuple[float, ...] = 8.0  # rad/s

    def __post_init__(self) -> None:
        each = (np.asarray(v, dtype=np.float64) for v in (self.error, self.command, self.change))
        if not all(np.isfinite(v).all() and (v > 0).all() for v in each):
            raise ValueError(f"weights must be > 0, got {self}")

    def of_commands(self, nu: int) -> tuple[np.ndarray, np.ndarray]:
        """(nu,) weights of the commands and (nu,) of their changes. Raises ValueError where there are not as many."""
        return np.broadcast_to(self.command, nu) ** -2.0, np.broadcast_to(self.change, nu) ** -2.0


@dataclass(frozen=True)
class Soft:
    """A soft limit on a tracked channel, a state or a force ("effort.<actuator>"), with the penalty
    price * v + square * v^2 / 2 for a violation of v units.
    """

    channel: str
    lower: float
    upper: float
    price: float = 100.0
    square: float = 1000.0

    def __post_init__(self) -> None:
        if not self.lower < self.upper or self.price < 0 or self.square <= 0:
            raise ValueError(f"lower must be below upper, price >= 0 and square > 0, got {self}")


@dataclass(frozen=True)
class Limits:
    """lower, upper: of every command, or one a command, actuator unit, never passed; rate: largest change a second, of
    every command or one each, inf for none; soft: see Soft.
    """

    lower: float | tuple[float, ...] = -12.0  # rad/s
    upper: float | tuple[float, ...] = 12.0  # rad/s
    rate: float | tuple[float, ...] = 100.0  # rad/s^2
    soft: tuple[Soft, ...] = ()

    def __post_init__(self) -> None:
        low, high = np.asarray(self.lower, dtype=np.float64), np.asarray(self.upper, dtype=np.float64)
        finite = np.isfinite(low).all() and np.isfinite(high).all()
        if not (finite and (low < high).all() and (np.asarray(self.rate) > 0).all()):
            raise ValueError(f"limits must be finite with lower below upper and rate > 0, got {self}")

    def box(self, nu: int) -> tuple[np.ndarray, np.ndarray]:
        """(nu,) lower and (nu,) upper. Raises ValueError where as many limits came as there are no commands."""
        return np.broadcast_to(self.lower, nu).astype(np.float64), np.broadcast_to(self.upper, nu).astype(np.float64)

    def most(self, nu: int, dt: float) -> np.ndarray:
        """(nu,) largest change within dt s; inf for none."""
        return np.broadcast_to(np.asarray(self.rate, dtype=np.float64) * dt, nu)


@dataclass(frozen=True)
class MpcSettings:
    """horizon: steps. iterations: quadratic programs a sample (1: real-time iteration); first: the same for the first
    sample of a run, which has no plan to start from. cruise: m/s, the speed at which the terminal cost is worked out.
    budget: s that a sample may take before the plan at hand is sent instead. By default the clock decides nothing, so
    that the same input gives the same command on a busy machine too; a robot's loop sets it. compile: whether a C
    compiler is used if found.
    """

    horizon: int = 20
    weights: Weights = Weights()
    limits: Limits = Limits()
    solver: Solver = "daqp"
    iterations: int = 1
    first: int = 5
    cruise: float = 0.2
    budget: float = math.inf
    compile: bool = True

    def __post_init__(self) -> None:
        if self.horizon < 2 or min(self.iterations, self.first) < 1 or not min(self.budget, self.cruise) > 0:
            raise ValueError("horizon must be >= 2, iterations and first >= 1, budget and cruise > 0")
