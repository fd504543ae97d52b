"""The velocities that the log says the robot had: x_ref of the paper's H2 norm |x_ref - x_pred|."""

from collections.abc import Sequence

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.local_fit import local_fit


def reference_velocities(data: Dataset, run: int, outputs: Sequence[str], t: np.ndarray) -> np.ndarray:
    """(N, outputs) m/s and rad/s at times t (N,) s of a run, NaN where nothing near was measured.

    From the logged velocity where there is one, else from the slope of a quadratic through five positions.
    """
    kinds = {o.partition(".")[0] for o in outputs}
    if kinds <= {"body", "twist"}:
        world = np.stack([_rate(data, run, f"pose.{a}", f"twist.{a}", t) for a in ("x", "y", "theta")], axis=-1)
        if kinds == {"twist"}:
            return world
        heading = _value(data, run, "pose.theta", t)
        c, s = np.cos(heading), np.sin(heading)
        x, y = world[:, 0].copy(), world[:, 1].copy()
        world[:, 0], world[:, 1] = c * x + s * y, c * y - s * x
        return world
    joints = [o.partition(".")[2] for o in outputs]
    return np.stack([_rate(data, run, f"position.{j}", f"velocity.{j}", t) for j in joints], axis=-1)


def _rate(data: Dataset, run: int, position: str, velocity: str, t: np.ndarray) -> np.ndarray:
    logged = _value(data, run, velocity, t)
    signal = data.signals.get((run, position))
    if signal is None:
        return logged
    return np.where(np.isfinite(logged), logged, local_fit(signal.t, t).slope(signal.y))


def _value(data: Dataset, run: int, channel: str, t: np.ndarray) -> np.ndarray:
    signal = data.signals.get((run, channel))
    return np.full(len(t), np.nan) if signal is None else local_fit(signal.t, t).value(signal.y)
