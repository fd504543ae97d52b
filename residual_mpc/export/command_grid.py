"""Commands held for one time, replayed by a model that insists on a step of its own."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class CommandGrid:
    """held: s, for which a command is held; step: s, of the model, which need not divide it."""

    held: float
    step: float

    def commands(self, u: np.ndarray) -> np.ndarray:
        """(rows, n, nu) at each of the model's steps, from u (rows, samples, nu): the one in the middle of the step."""
        n = int(np.ceil(u.shape[1] * self.held / self.step - 1e-6))
        middle = (np.arange(n) + 0.5) * self.step / self.held
        return np.asarray(u[:, np.minimum(np.floor(middle + 1e-9).astype(int), u.shape[1] - 1)])

    def at_sample(self, nodes: np.ndarray, k: int) -> np.ndarray:
        """(rows,) when sample k begins, between the nodes (rows, n + 1)."""
        place = k * self.held / self.step
        before = int(np.floor(place + 1e-6))
        part = place - before
        if abs(part) < 1e-6:
            return np.asarray(nodes[:, before])
        return np.asarray((1.0 - part) * nodes[:, before] + part * nodes[:, before + 1])
