"""The largest forces that a model lets its actuators give."""

import numpy as np

NO_LIMIT = 1e10  # N m: a force range that never bites, so that `saturation` can be set on any actuator


def largest_forces(ranges: np.ndarray) -> np.ndarray:
    """(nu,) N m or N, of ranges of forces (nu, 2); inf where they set no limit."""
    most = np.abs(ranges).max(axis=1, initial=0.0)
    return np.where(most < 0.5 * NO_LIMIT, most, np.inf)
