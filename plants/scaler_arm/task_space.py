"""A run of the arm as samples of the paper's task-space velocity model: what it says, what came, what the net sees."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from plants.scaler_arm.kinematics.forward import forward_kinematics, velocity
from plants.scaler_arm.kinematics.geometry import MOTORS, SCALER, Arm
from residual_mpc.errors import BadInput

COMMAND, POSITION = "command", "position"


@dataclass(frozen=True)
class TaskSamples:
    """One row a sample pair of a run.

    t (n,) s, of the later sample; rates (n, 6) rad/s, the network's input z; predicted (n, 3) m/s, fk_prop without its
    residual; came (n, 3) m/s, the tool's velocity over the same step by the encoders.
    """

    t: np.ndarray
    rates: np.ndarray
    predicted: np.ndarray
    came: np.ndarray

    @property
    def h2_norm(self) -> np.ndarray:
        """(n,) m/s: the Euclidean norm of reference minus prediction at each instant, as in the paper."""
        return np.asarray(np.linalg.norm(self.came - self.predicted, axis=1))


def task_samples(columns: Mapping[str, np.ndarray], t: np.ndarray, source: str, arm: Arm = SCALER) -> TaskSamples:
    """The samples of a run whose columns position.* and command.* (n + 1,) rad, velocity.* rad/s are by stamps t.

    source: "position" predicts from the measured angles and rates (what is left is noise and the motors' acceleration
    in one step), "command" from the commanded angles and their differences (what is left is all that the servos do).
    Raises BadInput for another source, a missing column, or a rate that is not constant.
    """
    steps = np.diff(t)
    if len(t) < 2 or np.ptp(steps) > 1e-6:
        raise BadInput("the time stamps are not evenly spaced", "task space", "resample the run to a constant rate")
    dt = float(steps[0])
    measured = _stack(columns, "position")
    if source == POSITION:
        q, rates = measured[:-1], _stack(columns, "velocity")[:-1]
    elif source == COMMAND:
        command = _stack(columns, "command")
        q, rates = command[:-1], np.diff(command, axis=0) / dt
    else:
        raise BadInput(f"source must be {POSITION!r} or {COMMAND!r}, got {source!r}", "task space")
    tool, _ = forward_kinematics(measured, arm)
    return TaskSamples(np.asarray(t[1:]), rates, velocity(q, rates, dt, arm), np.diff(tool, axis=0) / dt)


def _stack(columns: Mapping[str, np.ndarray], kind: str) -> np.ndarray:
    """(n, 6)."""
    missing = [f"{kind}.{m}" for m in MOTORS if f"{kind}.{m}" not in columns]
    if missing:
        raise BadInput(f"column {missing[0]} is missing", "task space", "log it, or map it under [log]")
    return np.stack([np.asarray(columns[f"{kind}.{m}"], dtype=np.float64) for m in MOTORS], axis=-1)
