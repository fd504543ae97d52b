"""What an experiment asks of a robot: the commands that are played, and what is to be logged besides."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from residual_mpc.errors import BadInput

Array = NDArray[np.float64]


@dataclass(frozen=True)
class CommandedMotion:
    """One motion. t: (n,) s, increasing from 0; commands: (n,) each, by actuator, held until the next row.

    enabled: (n,) of 0 or 1 each, by actuator, empty where no motor is switched off; sensors: channels to log besides
    the usual ones.
    """

    name: str
    t: Array
    commands: Mapping[str, Array]
    enabled: Mapping[str, Array]
    sensors: tuple[str, ...] = ()

    def table(self, actuators: Sequence[str]) -> Array:
        """(n, actuators) commands in this order. Raises BadInput for a robot that has others."""
        return _in_order(self.commands, actuators)

    def on(self, actuators: Sequence[str]) -> Array:
        """(n, actuators) 1 where the motor is on."""
        return _in_order(self.enabled, actuators) if self.enabled else np.ones((len(self.t), len(actuators)))


def read_commanded_motions(path: Path, sensors: Sequence[str] = ()) -> tuple[CommandedMotion, ...]:
    """The motions of a command file by `excite`, one a value of its column `run`."""
    import pandas as pd

    try:
        frame = pd.read_csv(path)
        named = [(str(n), rows) for n, rows in frame.groupby("run", sort=False)] if "run" in frame else [("", frame)]
        motions = [_commanded_motion(name, {str(c): rows[c].to_numpy() for c in rows}) for name, rows in named]
    except (OSError, ValueError, KeyError) as error:
        raise BadInput(
            f"not a valid command file ({error})", str(path), "write one with `residual-mpc excite`"
        ) from None
    return tuple(replace(m, sensors=tuple(sensors)) for m in motions)


def _commanded_motion(name: str, columns: Mapping[str, Array]) -> CommandedMotion:
    def under(prefix: str) -> dict[str, Array]:
        return {c.removeprefix(prefix): v.astype(float) for c, v in columns.items() if c.startswith(prefix)}

    return CommandedMotion(name, columns["t"].astype(float), under("command."), under("enabled."))


def _in_order(columns: Mapping[str, Array], actuators: Sequence[str]) -> Array:
    if set(columns) != set(actuators):
        raise BadInput(
            f"the commands must be for the actuators {', '.join(actuators)}, got {', '.join(columns)}", "commands"
        )
    return np.stack([columns[a] for a in actuators], axis=1)
