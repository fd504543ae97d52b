"""Numbers that are asked for again and again of the same samples, such as a channel's noise."""

from collections.abc import Callable
from functools import wraps
from hashlib import blake2b

import numpy as np

MOST = 10_000  # numbers that are kept of one function


def by_content(function: Callable[..., float]) -> Callable[..., float]:
    """The function of arrays of numbers (n,), given by position, computed once for the same content; it must depend on
    nothing else."""
    known: dict[bytes, float] = {}

    @wraps(function)
    def call(*arrays: np.ndarray) -> float:
        digest = blake2b(digest_size=16)
        for array in map(np.asarray, arrays):
            digest.update(f"{array.dtype.str}{array.shape}".encode())
            digest.update(array.tobytes())
        key = digest.digest()
        found = known.get(key)
        if found is None:
            if len(known) >= MOST:
                known.clear()
            found = known[key] = function(*arrays)
        return found

    return call
