"""Shapes of a robot on a fixed base that overlap, and the robot without contact between some of them."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from plants.mujoco_robot.loading.compile import mark_simple, prepared
from plants.mujoco_robot.structure.base import free_bodies
from plants.mujoco_robot.structure.compiled_robot import CompiledRobot
from plants.mujoco_robot.structure.ranges import AnyRobot

Pair = tuple[str, str]
WORLD = ""


def overlaps(robot: CompiledRobot, positions: Mapping[str, np.ndarray]) -> dict[Pair, np.ndarray]:
    """(rows,) m by which the shapes of two bodies overlap, 0 where they do not, at positions (rows,) of joints, rad or
    m; the others are as the model is drawn. What does not move is "". Nothing of a robot that drives, which stands on
    contacts, nor of one with closed chains, whose other joints follow; nothing of objects, whose place is not known."""
    import mujoco

    model = robot.model
    known = [
        (place, positions[j]) for j, place in zip(robot.joints, robot.places.tolist(), strict=True) if j in positions
    ]
    collides = model.ngeom and (model.geom_contype.any() or model.geom_conaffinity.any() or model.npair)
    if robot.base is not None or robot.loops is not None or not known or not collides:
        return {}
    data, count, objects = mujoco.MjData(model), len(known[0][1]), free_bodies(model)
    found: dict[Pair, np.ndarray] = {}
    for row in range(count):
        data.qpos[:] = model.qpos0
        for place, column in known:
            data.qpos[place] = column[row]
        if not np.isfinite(data.qpos).all():
            continue
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_collision(model, data)
        for geoms, distance in zip(data.contact.geom, data.contact.dist, strict=True):
            if np.isin(model.body_rootid[model.geom_bodyid[geoms]], objects).any():
                continue
            pair = _bodies(robot, geoms)
            depth = found.setdefault(pair, np.zeros(count))
            depth[row] = max(depth[row], -float(distance))
    return found


def _bodies(robot: CompiledRobot, geoms: Sequence[int]) -> Pair:
    """The bodies of two shapes; one that is fixed to the world stands for it."""
    model = robot.model
    bodies = sorted(int(model.geom_bodyid[g]) for g in geoms)
    one, other = (WORLD if model.body_weldid[b] == 0 else robot.links[b - 1] for b in bodies)
    return one, other


def without_contacts(robot: AnyRobot, pairs: Sequence[Pair]) -> AnyRobot:
    """The robot whose bodies do not touch each other in these pairs, nor the world where one of the two is ""."""
    if robot.spec is None:
        return robot
    spec = robot.spec.copy()
    for number, body in enumerate(spec.bodies):
        body.name = body.name or robot.links[number - 1]
    for pair in pairs:
        for one, other in _named(robot, pair):
            exclude = spec.add_exclude()
            exclude.bodyname1, exclude.bodyname2 = one, other
    mark_simple(spec, False)
    return replace(robot, model=prepared(spec.compile()), spec=spec)


def _named(robot: CompiledRobot, pair: Pair) -> list[Pair]:
    """The pair by the names of bodies; for the world, each body that is fixed to it."""
    if all(pair):
        return [pair]
    fixed = [b for b in range(robot.model.nbody) if robot.model.body_weldid[b] == 0]
    names = ["world" if b == 0 else robot.links[b - 1] for b in fixed]
    return [(name, next(filter(None, pair))) for name in names]
