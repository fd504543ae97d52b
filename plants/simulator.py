"""What a simulated robot offers: command in, sensor readings out, at a rate of one's choice; and recording its runs.

    simulator = MujocoDrive(Geometry())                     # frozen: what the robot is
    plant = simulator.start(rng, {"pose.theta": 0.5})       # a leaf that owns the engine: the robot in motion
    while plant.time < 10.0:
        reading = plant.measure()                           # what the sensors report now
        plant.step(policy(plant.time, reading), 0.02)       # the command is held for 0.02 s
    plant.close()

An engine keeps its state to itself, so a plant is a leaf with one owner, not a pure function; `start` with a
generator of the same seed gives the same plant again. What changes a simulator (sensors, withheld effects) wraps it.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np

from residual_mpc.errors import BadInput

if TYPE_CHECKING:
    import pandas as pd

Reading = Mapping[str, float]  # run-log channel -> value in the channel's unit; NaN where a sensor has nothing new
Policy = Callable[[float, Reading], np.ndarray]  # time s, reading -> command (nu,), in the order of `actuators`


class Plant(Protocol):
    """A robot in motion. Not for several threads."""

    @property
    def time(self) -> float:
        """s since `start`."""
        ...

    def measure(self) -> Reading:
        """What the sensors report now. Call it once a sample: noise is drawn, and a slow sensor reports once."""
        ...

    def truth(self) -> Reading:
        """The same channels without noise, delay or dropout, for scoring alone."""
        ...

    def step(self, command: np.ndarray, dt: float) -> None:
        """Hold command (nu,), actuator units, for dt s. The engine divides dt into steps of its own."""
        ...

    def close(self) -> None:
        """Give the engine back; nothing else may be called afterwards."""
        ...


class Simulator(Protocol):
    """A robot that can be put into motion; frozen."""

    @property
    def name(self) -> str: ...

    @property
    def actuators(self) -> tuple[str, ...]:
        """Names after `command.`, in the order of Plant.step's command."""
        ...

    @property
    def channels(self) -> tuple[str, ...]:
        """The keys of every reading, by the run log's names."""
        ...

    def start(self, rng: np.random.Generator, at: Reading) -> Plant:
        """A plant at rest at the state `at` (channels that are not named start at 0); rng draws all that is random."""
        ...


@dataclass(frozen=True)
class Recording:
    """How a run is logged: `seconds` long, a row and a command every `period` s, from the state `at`."""

    seconds: float
    period: float
    at: Reading

    def __post_init__(self) -> None:
        if not (self.period > 0 and np.isfinite(self.seconds) and self.seconds >= self.period):
            raise BadInput(
                f"a run must have at least two rows, got {self.seconds} s with a row every {self.period} s", "recording"
            )

    @property
    def rows(self) -> int:
        return int(np.floor(self.seconds / self.period + 1e-9)) + 1


@contextmanager
def running(simulator: Simulator, rng: np.random.Generator, at: Reading) -> Iterator[Plant]:
    """A plant that is closed however the block ends."""
    plant = simulator.start(rng, at)
    try:
        yield plant
    finally:
        plant.close()


def record(simulator: Simulator, policy: Policy, recording: Recording, rng: np.random.Generator) -> "pd.DataFrame":
    """One run in the contract's format: `t`, `command.*` and the simulator's channels.

    A row holds what the sensors reported at t and the command sent right after that, which is held until the next row.
    """
    import pandas as pd

    rows = []
    with running(simulator, rng, recording.at) as plant:
        for k in range(recording.rows):
            t = k * recording.period
            reading = plant.measure()
            command = np.asarray(policy(t, reading), dtype=np.float64)
            rows.append((t, *command.tolist(), *(reading[c] for c in simulator.channels)))
            if k + 1 < recording.rows:
                plant.step(command, recording.period)
    commands = (f"command.{a}" for a in simulator.actuators)
    return pd.DataFrame(rows, columns=["t", *commands, *simulator.channels])


def replaying(commands: np.ndarray, period: float) -> Policy:
    """The policy that sends row k of commands (n, nu) from k * period s on, and the last row for ever."""

    def policy(t: float, reading: Reading) -> np.ndarray:
        return np.asarray(commands[min(int(t / period + 1e-6), len(commands) - 1)])

    return policy


def write_run(table: "pd.DataFrame", path: Path) -> None:
    """Write a run as CSV to the last digit; a missing sample is an empty cell."""
    path.parent.mkdir(parents=True, exist_ok=True)
    table.to_csv(path, index=False, lineterminator="\n")
