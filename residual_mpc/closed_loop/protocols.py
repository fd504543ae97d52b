"""What the loop needs of a plant, a controller and a reference; whoever has these methods can be in it."""

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np

Reading = Mapping[str, float]  # run-log channel -> value; NaN where a sensor has nothing new


class Plant(Protocol):
    """A robot in motion, with one owner."""

    def measure(self) -> Reading:
        """What the sensors report now; once a sample."""
        ...

    def truth(self) -> Reading:
        """The same without noise, for scoring; a real robot gives its best measurement."""
        ...

    def step(self, command: np.ndarray, dt: float) -> None:
        """Hold command (nu,) for dt s."""
        ...

    def close(self) -> None: ...


class Simulator(Protocol):
    """What can be put into motion again and again; the same seed gives the same plant."""

    @property
    def actuators(self) -> tuple[str, ...]: ...

    @property
    def channels(self) -> tuple[str, ...]: ...

    def start(self, rng: np.random.Generator, at: Reading) -> Plant: ...


class Reference(Protocol):
    """Where the robot should be."""

    def path(self, t: np.ndarray) -> np.ndarray:
        """(n, ny) poses at increasing times t (n,) s from 0 on, in the order of the model's poses; angles unwrapped."""
        ...


class ControllerInfo(Protocol):
    """What a controller says about one sample."""

    @property
    def outcome(self) -> str:
        """Anything but "solved" and "inaccurate" counts as a failure."""
        ...

    @property
    def seconds(self) -> float: ...


class Controller(Protocol):
    """Memory is explicit: a state goes in and comes out."""

    @property
    def horizon(self) -> int:
        """How many future samples of the reference it wants."""
        ...

    def init(self) -> Any: ...

    def step(self, state: Any, x: np.ndarray, reference: np.ndarray) -> tuple[np.ndarray, Any, ControllerInfo]:
        """Command (nu,) from the estimate x (nx,) and the reference at the next samples (horizon, ny)."""
        ...

    def with_parameters(self, p: np.ndarray) -> "Controller":
        """The same controller, its model with other numbers (np,)."""
        ...
