"""The size and the distance of a driving robot's wheels, as effects; batched."""

from typing import TYPE_CHECKING, Any

import numpy as np

from plants.mujoco_robot.structure.wheels import Wheels, round_sizes
from residual_mpc.effects.library import Effects, changes

if TYPE_CHECKING:
    import mujoco


def edit_wheels(batch: Any, model: "mujoco.MjModel", wheels: Wheels, effects: Effects) -> bool:
    """Write radii and track into the batch; whether derived constants have to follow.

    A hub moves up or down with its wheel's radius, so that the chassis stands as it stood.
    """
    both, right, track = (changes(effects, q) for q in ("wheel radius", "right wheel radius", "track width"))
    if both is None and right is None and track is None:
        return False
    place = batch.expand("body_pos")
    if track is not None:
        place[:, wheels.body, 1] *= track
    factor = np.ones((place.shape[0], len(wheels.body)))
    if both is not None:
        factor = factor * both
    if right is not None:
        factor = np.where(wheels.right, factor * right, factor)
    if not (factor == 1.0).all():
        place[:, wheels.body, 2] += (factor - 1.0) * wheels.radius
        size, bound = batch.expand("geom_size"), batch.expand("geom_rbound")
        for k, geoms in enumerate(wheels.geoms):
            for g in geoms:
                size[:, g, :] *= np.where(round_sizes(model, g), factor[:, k, None], 1.0)
                bound[:, g] *= np.maximum(factor[:, k], 1.0)
    return True
