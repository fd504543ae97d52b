"""What the position servos had to correct before a window: what an integral part remembers at its start."""

from dataclasses import dataclass, fields, replace

import numpy as np


@dataclass(frozen=True, eq=False)
class PastErrors:
    """As the log has it, (B, nu) each; zeros at actuators that take no positions, or whose joint is not measured, where
    `known` is 0 instead of 1.

    sent, turned: integrals of the command and of the joint's position, from the run's first stamp, or from where the
    actuator was last switched on, to the window's start, command unit s and rad s. whole: 1 where that is the run's
    first stamp, else 0. begun_sent: the command there. Over the run's first half second: first_sent, first_at: their
    means; first_rate: of the position, rad/s; early_sent, early_turned: the means of their integrals since the first
    stamp.
    """

    known: np.ndarray
    sent: np.ndarray
    turned: np.ndarray
    whole: np.ndarray
    begun_sent: np.ndarray
    first_sent: np.ndarray
    first_at: np.ndarray
    first_rate: np.ndarray
    early_sent: np.ndarray
    early_turned: np.ndarray

    def take(self, rows: np.ndarray) -> "PastErrors":
        """The rows named by an index or a mask, in that order."""
        return replace(self, **{f.name: getattr(self, f.name)[rows] for f in fields(self)})
