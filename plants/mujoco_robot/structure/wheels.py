"""The wheels that a driving robot stands on."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from plants.mujoco_robot.structure.base import ROLLS, Base, hinges_and_slides

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


def find_wheels(model: "mujoco.MjModel", base: Base) -> Wheels | None:
    """The driven wheels that hang on the chassis itself; None unless there are some on both sides and all are round."""
    joints = hinges_and_slides(model)
    driven = np.isin(joints, model.actuator_trnid[:, 0])
    chosen = np.flatnonzero(driven & (np.abs(base.rolling[:, 0]) > ROLLS))
    body = np.asarray(model.jnt_bodyid[joints[chosen]])
    right = model.body_pos[body, 1] < 0
    geoms = tuple(tuple(np.flatnonzero(model.geom_bodyid == b).tolist()) for b in body)
    hung = (model.body_parentid[body] == base.body) & (model.body_pos[body, 1] != 0)
    round_ = all(gs and all(round_sizes(model, g).any() for g in gs) for gs in geoms)
    if not (hung.all() and round_ and right.any() and not right.all()):
        return None
    return Wheels(body, 1.0 / np.abs(base.rolling[chosen, 0]), right, geoms)


def round_sizes(model: "mujoco.MjModel", geom: int) -> np.ndarray:
    """(3,) bool: which entries of the geom's size are its radius; none where it is not round."""
    import mujoco

    kind, g = int(model.geom_type[geom]), mujoco.mjtGeom
    if kind == int(g.mjGEOM_ELLIPSOID):
        return np.ones(3, dtype=bool)
    return np.array([kind in (int(g.mjGEOM_SPHERE), int(g.mjGEOM_CYLINDER), int(g.mjGEOM_CAPSULE)), False, False])
