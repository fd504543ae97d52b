"""The arm's tool velocities as the paper's equation fk_prop has them: model, encoders, network inputs."""

from typing import TYPE_CHECKING

import numpy as np

from plants.scaler_arm.engines.pybullet_arm import PybulletArm
from plants.scaler_arm.kinematics.forward import forward_kinematics, velocity_by_jacobian
from plants.scaler_arm.kinematics.geometry import MOTORS
from plants.scaler_arm.kinematics.loop_closure import at_posture
from plants.scaler_arm.motions import Motion, references
from plants.simulator import Recording, Simulator, record, replaying
from residual_mpc.learning.stream.samples import Samples

if TYPE_CHECKING:
    import pandas as pd

PERIOD = 0.01  # s, of the commands, as in the paper
SUB = 5  # rows in a sample: encoders that count need time to tell a velocity


def drive(simulator: Simulator, motion: Motion, seconds: float, rng: np.random.Generator) -> "pd.DataFrame":
    """A run whose commands are the motor angles of the motion."""
    t = PERIOD * np.arange(round(seconds / PERIOD) + 1)
    commands = references(motion, t)
    how = Recording(float(t[-1]), PERIOD, at_posture(commands[0]))
    return record(simulator, replaying(commands, PERIOD), how, rng)


def simulated(run: "pd.DataFrame") -> np.ndarray:
    """(n, 3) m/s: the simulator's own tool under the run's commands, mean over each sample."""
    commands = _columns(run, "command")
    how = Recording(float(run["t"].iloc[-1]), PERIOD, at_posture(commands[0]))
    own = record(PybulletArm(), replaying(commands, PERIOD), how, np.random.default_rng(0))
    tool, _ = forward_kinematics(_columns(own, "position")[::SUB])
    return np.asarray(np.diff(tool, axis=0) / (SUB * PERIOD))


def samples(run: "pd.DataFrame", model: np.ndarray | None = None) -> Samples:
    """One sample every SUB rows: means over that time.

    model (n, 3): the current model's tool velocity; None: fk_prop of the commanded angles, for the measured ones would
    leave nothing to learn. The network sees the commanded joint rates. The reference is the tool's velocity by the
    encoders' angles and rates.
    """
    q = _columns(run, "command")[::SUB]
    dt = SUB * PERIOD
    if model is None:
        tool, _ = forward_kinematics(q)
        model = np.diff(tool, axis=0) / dt
    rates = _columns(run, "velocity")
    came = velocity_by_jacobian(_columns(run, "position"), rates)
    n = len(model)
    ends = 0.5 * (came[1:] + came[:-1])  # over each row's period
    reference = ends[: n * SUB].reshape(n, SUB, 3).mean(axis=1)
    t = run["t"].to_numpy()[::SUB][1:]
    return Samples(t, np.diff(q, axis=0) / dt, model, reference, dt)


def _columns(run: "pd.DataFrame", kind: str) -> np.ndarray:
    """(n, 6)."""
    return np.asarray(run[[f"{kind}.{m}" for m in MOTORS]].to_numpy())
