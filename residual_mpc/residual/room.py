"""Memory that the filter computes in, update after update."""

import numpy as np


class Room:
    """Arrays that serve again from update to update: to ask the system for fresh ones costs more than what is computed
    in them. Each thread needs its own."""

    def __init__(self) -> None:
        self._arrays: dict[tuple[int, str], np.ndarray] = {}

    def array(self, layer: int, use: str, shape: tuple[int, ...]) -> np.ndarray:
        """An array of this shape, float64, with whatever was left in it."""
        found = self._arrays.get((layer, use))
        if found is None or found.shape != shape:
            found = self._arrays[layer, use] = np.empty(shape)
        return found
