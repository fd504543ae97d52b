"""The process that renders. It is run as a file and imports MuJoCo and NumPy alone, so that it starts quickly.

    MUJOCO_GL=egl python worker.py task.pickle shade.npy
"""

import os
import pickle
import sys
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    import mujoco

THICK = 0.018  # of the picture's height: the radius of a capsule that stands for a body without a shape
BALL = 1.5  # times that: the radius of a ball at each of its ends
SHAPED = 0.5  # share of the moving bodies with a shape at their joint, below which the skeleton is drawn as well
GREY = (0.8, 0.8, 0.8, 1.0)
AMBIENT, DIFFUSE = 0.45, 0.5  # of the light at the camera: no part of the robot is black, which stands for nothing
VISIBLE = 3  # groups of shapes that MuJoCo's viewer shows; collision shapes are in others


class Task(NamedTuple):
    """qpos (N, F, nq); skeletons (N, F, S, 2, 3) m; target (3,) m, azimuth and elevation in degrees, height in m and
    size in px as in residual_mpc.models.drawing.Camera."""

    model: "mujoco.MjModel"
    qpos: np.ndarray
    skeletons: np.ndarray
    target: tuple[float, float, float]
    azimuth: float
    elevation: float
    height: float
    size: tuple[int, int]


def render(task: Task) -> np.ndarray:
    """(N, F, height, width) uint8: the robot's brightness, 0 where it is not."""
    import mujoco

    model, (width, height) = task.model, task.size
    capsules = prepare(model)
    view = model.vis.global_
    view.offwidth, view.offheight = max(view.offwidth, width), max(view.offheight, height)
    view.orthographic, view.fovy = 1, task.height
    camera, option = mujoco.MjvCamera(), mujoco.MjvOption()
    camera.orthographic = 1
    camera.lookat[:], camera.azimuth, camera.elevation = task.target, task.azimuth, task.elevation
    camera.distance = 2.0 * task.height
    near, far = (k * task.height / model.stat.extent for k in (0.01, 10.0))
    model.vis.map.znear, model.vis.map.zfar = near, far
    option.sitegroup[:] = option.tendongroup[:] = option.actuatorgroup[:] = option.skingroup[:] = 0
    data = mujoco.MjData(model)
    renderer = mujoco.Renderer(model, height, width, max_geom=model.ngeom + 3 * task.skeletons.shape[2] + 100)
    for flag in (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_REFLECTION, mujoco.mjtRndFlag.mjRND_SKYBOX,
                 mujoco.mjtRndFlag.mjRND_HAZE, mujoco.mjtRndFlag.mjRND_FOG):  # fmt: skip
        renderer.scene.flags[flag] = 0
    out = np.zeros((*task.qpos.shape[:2], height, width), dtype=np.uint8)
    for n, f in np.ndindex(*task.qpos.shape[:2]):
        data.qpos[:] = task.qpos[n, f]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_camlight(model, data)
        renderer.update_scene(data, camera, option)
        if capsules:
            add_capsules(renderer.scene, task.skeletons[n, f], THICK * task.height)
        out[n, f] = renderer.render().max(axis=-1)
    return out


def prepare(model: "mujoco.MjModel") -> bool:
    """Paint all shapes grey under one light at the camera and hide the ground. Whether the skeleton is to be drawn as
    well, since few of the moving bodies have a shape that reaches their origin, where their joint is."""
    import mujoco

    ground = np.isin(model.geom_type, (int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_HFIELD)))
    shown = ~ground & (model.geom_group < VISIBLE) & (model.geom_rgba[:, 3] > 0)
    model.geom_rgba[:], model.geom_matid[:] = GREY, -1
    model.geom_rgba[~shown, 3] = 0.0
    if model.nlight:
        model.light_active[:] = 0
    head = model.vis.headlight
    head.active, head.ambient[:], head.diffuse[:], head.specular[:] = 1, AMBIENT, DIFFUSE, 0.0
    moving = set(np.flatnonzero(model.body_weldid > 0).tolist())
    near = shown & (np.linalg.norm(model.geom_pos, axis=1) <= model.geom_rbound)
    return len(moving & set(model.geom_bodyid[near].tolist())) < SHAPED * len(moving)


def add_capsules(scene: "mujoco.MjvScene", segments: np.ndarray, radius: float) -> None:
    """Put a capsule on every segment (S, 2, 3) m into the scene, and a ball on each of its ends."""
    import mujoco

    capsule, ball = int(mujoco.mjtGeom.mjGEOM_CAPSULE), int(mujoco.mjtGeom.mjGEOM_SPHERE)
    rgba, level = np.array(GREY, np.float32), np.eye(3).ravel()
    for segment in segments:
        for kind, size, place in ((capsule, 0.0, segment[0]), *((ball, BALL * radius, end) for end in segment)):
            geom = scene.geoms[scene.ngeom]
            mujoco.mjv_initGeom(geom, kind, np.full(3, size), place, level, rgba)
            if kind == capsule:
                mujoco.mjv_connector(geom, kind, radius, *segment)
            scene.ngeom += 1


def main(asked: Path, made: Path) -> None:
    np.save(made, render(Task(*pickle.loads(asked.read_bytes()))))
    sys.stderr.flush()
    os._exit(0)  # some drivers fail at their clean-up, when the pictures are there already


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
