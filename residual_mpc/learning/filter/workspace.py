"""Memory that the filter computes in, update after update."""

from math import prod

import numpy as np

LINE = 64  # bytes of a cache line: an addition of arrays that begin within one takes twice as long


class Workspace:
    """Arrays that serve again from update to update: to ask the system for fresh ones costs more than what is computed
    in them. Each begins with a cache line. Each thread needs its own."""

    def __init__(self) -> None:
        self._arrays: dict[tuple[int, str], np.ndarray] = {}

    def array(self, layer: int, use: str, shape: tuple[int, ...]) -> np.ndarray:
        """An array of this shape, float64, with whatever was left in it."""
        found = self._arrays.get((layer, use))
        if found is None or found.shape != shape:
            found = self._arrays[layer, use] = _aligned(shape)
        return found


def _aligned(shape: tuple[int, ...]) -> np.ndarray:
    size, spare = prod(shape), LINE // 8
    raw = np.empty(size + spare)
    first = -(raw.ctypes.data // 8) % spare
    return raw[first : first + size].reshape(shape)
