"""Commands held for a fixed time, replayed by a model with a step of its own."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class CommandGrid:
    """held: s for which a command is held; step: s of the model's step, which need not divide `held`."""

    held: float
    step: float

    def commands(self, u: np.ndarray) -> np.ndarray:
        """(rows, n, nu) for each step of the model, from u (rows, samples, nu): the command at its middle."""
        n = int(np.ceil(u.shape[1] * self.held / self.step - 1e-6))
        middle = (np.arange(n) + 0.5) * self.step / self.held
        return np.asarray(u[:, np.minimum(np.floor(middle + 1e-9).astype(int), u.shape[1] - 1)])

    def at_sample(self, nodes: np.ndarray, k: int) -> np.ndarray:
        """(rows,) at the start of sample k, interpolated between the nodes (rows, n + 1)."""
        place = k * self.held / self.step
        before = int(np.floor(place + 1e-6))
        part = place - before
        if abs(part) < 1e-6:
            return np.asarray(nodes[:, before])
        return np.asarray((1.0 - part) * nodes[:, before] + part * nodes[:, before + 1])
