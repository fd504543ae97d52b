"""A plant of the user's own, whose mistakes become one message."""

import traceback
from collections.abc import Callable, Mapping
from contextlib import nullcontext, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from residual_mpc.closed_loop.protocols import Plant, Reading, Simulator
from residual_mpc.errors import BadInput

Value = TypeVar("Value")
METHODS = ("measure", "truth", "step", "close")


@dataclass(frozen=True, eq=False)
class Guarded:
    """A simulator of the user's own. poses: the channels that its readings must have. Raises BadInput for whatever it
    raises, and for readings that are no mapping or lack a channel."""

    inner: Simulator
    poses: tuple[str, ...]
    where: str

    @property
    def actuators(self) -> tuple[str, ...]:
        return tuple(self.inner.actuators)

    @property
    def channels(self) -> tuple[str, ...]:
        return self.poses

    def start(self, rng: np.random.Generator, at: Reading) -> Plant:
        plant = guarded(self.where, "`start`", lambda: self.inner.start(rng, at))
        lacks = [m for m in METHODS if not callable(getattr(plant, m, None))]
        if lacks:
            raise BadInput(
                f"`start` must return a plant with {', '.join(METHODS)}, got {type(plant).__name__} without {lacks[0]}",
                self.where, "see docs/guide/closed-loop.md for a plant",
            )  # fmt: skip
        return _GuardedPlant(plant, self.poses, self.where, at)

    def try_out(self, at: Reading) -> None:
        """Start the plant, and read its sensors once. Raises BadInput as a run would."""
        plant = self.start(np.random.default_rng(0), at)
        try:
            plant.measure()
            plant.truth()
        finally:
            with suppress(BadInput):  # a run may fail before it closes the plant, and then says that
                plant.close()


def check_actuators(plant: Simulator, commands: tuple[str, ...], where: str) -> None:
    """Raises BadInput for a plant whose actuators are not those that the model commands, in this order."""
    found = guarded(where, "`actuators`", lambda: tuple(plant.actuators))
    if found != tuple(commands):
        raise BadInput(
            f"the plant must have the actuators {', '.join(commands)} in this order, got {', '.join(map(str, found))}",
            where, "name them so in its `actuators`",
        )  # fmt: skip


class _GuardedPlant:
    """A running plant whose readings are checked."""

    def __init__(self, inner: Plant, poses: tuple[str, ...], where: str, begin: Reading) -> None:
        self._inner, self._poses, self._where = inner, poses, where
        self._last, self._failed = dict(begin), False

    def measure(self) -> Reading:
        return self._checked("measure", self._inner.measure)

    def truth(self) -> Reading:
        """A channel without a new value keeps its last one: errors are scored at every sample."""
        found = self._checked("truth", self._inner.truth)
        self._last |= {c: v for c, v in found.items() if np.isfinite(v)}
        return {c: self._last[c] for c in found}

    def step(self, command: np.ndarray, dt: float) -> None:
        self._guarded("`step()`", lambda: self._inner.step(command, dt))

    def close(self) -> None:
        with suppress(Exception) if self._failed else nullcontext():  # the first failure is the one to report
            self._guarded("`close`", self._inner.close)

    def _guarded(self, method: str, call: Callable[[], Value]) -> Value:
        """What the method returns; remembers that it failed."""
        self._failed = True
        found = guarded(self._where, method, call)
        self._failed = False
        return found

    def _checked(self, method: str, read: Callable[[], Reading]) -> Reading:
        """The tracked channels of a reading as floats; a sensor without a new value gives NaN."""
        reading = self._guarded(f"`{method}`", read)
        self._failed = True
        remedy = f"return a dict with {', '.join(self._poses)}; NaN where a sensor has nothing new"
        if not isinstance(reading, Mapping):
            raise BadInput(f"`{method}` must return a dict, got {type(reading).__name__}", self._where, remedy)
        missing = [c for c in self._poses if c not in reading]
        if missing:
            raise BadInput(f"the reading of `{method}` has no {missing[0]!r}", self._where, remedy)
        found: dict[str, float] = {}
        for channel in self._poses:
            value: Any = reading[channel]
            if np.size(value) != 1 or not isinstance(np.asarray(value).item(), int | float):
                raise BadInput(f"`{method}` gives no number for {channel}: {value!r}", self._where, remedy)
            found[channel] = float(np.asarray(value).item())
        self._failed = False
        return found


def guarded(where: str, method: str, call: Callable[[], Value]) -> Value:
    """What the user's code returns. Raises BadInput for what it raises, with the line that did."""
    try:
        return call()
    except BadInput:
        raise
    except Exception as error:  # the user's own code may raise anything
        raise BadInput(
            f"{method} of the plant raised {type(error).__name__}: {error}{_line_of(error)}", where,
            "test the plant on its own",
        ) from error  # fmt: skip


def _line_of(error: BaseException) -> str:
    """The last line of the user's own code that an error came through; empty where it did not."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [f for f in frames if "site-packages" not in f.filename and Path(f.filename) != Path(__file__)]
    return f" ({own[-1].filename}, line {own[-1].lineno})" if own else ""
