"""The outline of a driving robot from above, from the boxes around its shapes."""

import itertools

import numpy as np

from plants.mujoco_robot.structure.base import PLANAR, Base
from plants.mujoco_robot.structure.compiled_robot import CompiledRobot
from plants.outline import box_with_nose

SIDES = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))


def outline(robot: CompiledRobot, base: Base) -> np.ndarray:
    """(7, 2) m, x forward: see residual_mpc.models.drawing.Outlined. Where no shape is known: around the bodies."""
    import mujoco

    model = robot.model
    data = mujoco.MjData(model)
    q, v = model.qpos0[None].copy(), np.zeros((1, model.nv))
    base.write(q, v, {f"{kind}.{axis}": np.zeros(1) for kind in ("pose", "twist") for axis in PLANAR})
    data.qpos[:] = q[0]
    mujoco.mj_kinematics(model, data)
    mine = model.body_rootid == model.body_rootid[base.body]
    points = [data.xpos[mine]]
    for g in np.flatnonzero(mine[model.geom_bodyid]):
        centre, half = model.geom_aabb[g, :3], model.geom_aabb[g, 3:]
        points.append(data.geom_xpos[g] + (centre + SIDES * half) @ data.geom_xmat[g].reshape(3, 3).T)
    seen = np.concatenate(points)[:, :2]
    low, high = seen.min(axis=0), seen.max(axis=0)
    return box_with_nose((float(low[0]), float(low[1])), (float(high[0]), float(high[1])))
