"""The paper's low-pass filter on the network's output, for localisation with spikes; a memory with init and step."""

import numpy as np


def init(outputs: int) -> np.ndarray:
    """The filter's state (outputs,) before any output: at rest."""
    return np.zeros(outputs)


def step(state: np.ndarray, delta: np.ndarray, dt: float, time_constant: float) -> tuple[np.ndarray, np.ndarray]:
    """(filtered output, next state), both (outputs,), of an output delta held over dt s; exact for that hold.

    A time constant of 0 s lets the output through. Raises ValueError for a negative one, or a dt that is not positive.
    """
    if not (dt > 0.0 and time_constant >= 0.0):
        raise ValueError(f"dt must be > 0 and time_constant >= 0, got {dt} s and {time_constant} s")
    share = 1.0 if time_constant == 0.0 else -np.expm1(-dt / time_constant)
    out = state + share * (delta - state)
    return out, out
