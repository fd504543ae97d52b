"""The largest forces that a model lets its actuators give."""

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import mujoco

NO_LIMIT = 1e10  # N m: a force range that never bites, so that `saturation` can be set on any actuator


def largest_forces(model: "mujoco.MjModel") -> np.ndarray:
    """(nu,) N m or N; inf where the model sets no limit."""
    most = np.abs(model.actuator_forcerange).max(axis=1, initial=0.0)
    return np.where(most < 0.5 * NO_LIMIT, most, np.inf)
