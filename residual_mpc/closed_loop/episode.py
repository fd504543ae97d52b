"""One closed-loop run: what was wanted, measured, believed, sent and true at every sample: a run of the log format."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from residual_mpc.logs.run import Run

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, eq=False)
class Episode:
    """n samples at t (n,) s.

    command (n, nu), actuator units, sent at t and held. measured: channel -> (n,). truth, reference, believed: (n, ny)
    of `poses`. predicted (n, ny): the rates that the controller's model expects over the step that begins at t, and
    happened (n, ny): those that came (unit of the pose / s); NaN at the last sample. seconds (n,) of the controller;
    outcomes: n words.
    """

    name: str
    actuators: tuple[str, ...]
    poses: tuple[str, ...]
    t: np.ndarray
    command: np.ndarray
    measured: Mapping[str, np.ndarray]
    truth: np.ndarray
    reference: np.ndarray
    believed: np.ndarray
    predicted: np.ndarray
    happened: np.ndarray
    seconds: np.ndarray
    outcomes: tuple[str, ...]

    def run(self) -> Run:
        """What a robot's log would hold: commands and measurements, nothing of the truth."""
        commands = {f"command.{a}": self.command[:, i].copy() for i, a in enumerate(self.actuators)}
        return Run(self.name, self.t.copy(), {**commands, **{c: v.copy() for c, v in self.measured.items()}})

    def table(self) -> "pd.DataFrame":
        """The run with reference and truth beside it (columns that the log format does not know, and keeps)."""
        import pandas as pd

        columns = {"t": self.t, **self.run().columns}
        columns |= {f"reference.{c}": self.reference[:, i] for i, c in enumerate(self.poses)}
        columns |= {f"truth.{c}": self.truth[:, i] for i, c in enumerate(self.poses)}
        return pd.DataFrame(columns)
