"""The wheels that a driving robot stands on: their size and their distance as effects, batched."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from plants.mujoco_robot.base import ROLLS, Base, hinges_and_slides
from residual_mpc.effects.library import Effects, changes

if TYPE_CHECKING:
    import mujoco


@dataclass(frozen=True, eq=False)
class Wheels:
    """Driven wheels fixed to the chassis, some on either side.

    body (w,) numbers; radius (w,) m, as it rolls; right (w,) bool; geoms: of each wheel, round about its axle.
    """

    body: np.ndarray
    radius: np.ndarray
    right: np.ndarray
    geoms: tuple[tuple[int, ...], ...]

    def edit(self, batch: Any, model: "mujoco.MjModel", effects: Effects) -> bool:
        """Write radius and track into the batch; whether derived constants have to follow.

        A hub moves up or down with its wheel's radius, so that the chassis stands as it stood.
        """
        both, right, track = (changes(effects, q) for q in ("wheel radius", "right wheel radius", "track width"))
        if both is None and right is None and track is None:
            return False
        place = batch.expand("body_pos")
        if track is not None:
            place[:, self.body, 1] *= track
        factor = np.ones((place.shape[0], len(self.body)))
        if both is not None:
            factor = factor * both
        if right is not None:
            factor = np.where(self.right, factor * right, factor)
        if not (factor == 1.0).all():
            place[:, self.body, 2] += (factor - 1.0) * self.radius
            size, bound = batch.expand("geom_size"), batch.expand("geom_rbound")
            for k, geoms in enumerate(self.geoms):
                for g in geoms:
                    size[:, g, :] *= np.where(_round(model, g), factor[:, k, None], 1.0)
                    bound[:, g] *= np.maximum(factor[:, k], 1.0)
        return True


def find_wheels(model: "mujoco.MjModel", base: Base) -> Wheels | None:
    """The driven wheels that hang on the chassis itself; None unless there are some on both sides and all are round."""
    joints = hinges_and_slides(model)
    driven = np.isin(joints, model.actuator_trnid[:, 0])
    chosen = np.flatnonzero(driven & (np.abs(base.rolling[:, 0]) > ROLLS))
    body = np.asarray(model.jnt_bodyid[joints[chosen]])
    right = model.body_pos[body, 1] < 0
    geoms = tuple(tuple(np.flatnonzero(model.geom_bodyid == b).tolist()) for b in body)
    hung = (model.body_parentid[body] == base.body) & (model.body_pos[body, 1] != 0)
    round_ = all(gs and all(_round(model, g).any() for g in gs) for gs in geoms)
    if not (hung.all() and round_ and right.any() and not right.all()):
        return None
    return Wheels(body, 1.0 / np.abs(base.rolling[chosen, 0]), right, geoms)


def _round(model: "mujoco.MjModel", geom: int) -> np.ndarray:
    """(3,) bool: which entries of the geom's size are its radius; none where it is not round."""
    import mujoco

    kind, g = int(model.geom_type[geom]), mujoco.mjtGeom
    if kind == int(g.mjGEOM_ELLIPSOID):
        return np.ones(3, dtype=bool)
    return np.array([kind in (int(g.mjGEOM_SPHERE), int(g.mjGEOM_CYLINDER), int(g.mjGEOM_CAPSULE)), False, False])
