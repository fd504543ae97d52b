"""A robot's bodies as line segments, for models with and without shapes."""

import numpy as np

from plants.mujoco_robot.simulation.channels import write_start
from plants.mujoco_robot.structure.compiled_robot import CompiledRobot
from residual_mpc.models.drawing import Motion

SHORT = 1e-3  # m: a segment that never gets longer is left out


def positions(robot: CompiledRobot, motion: Motion) -> np.ndarray:
    """(F, nq) MuJoCo's positions, from the position channels (F,) of the robot's states."""
    frames = len(next(iter(motion.values())))
    q, v = np.tile(robot.model.qpos0, (frames, 1)), np.zeros((frames, robot.model.nv))
    still = {s.velocity: np.zeros(frames) for s in robot.states if s.velocity is not None}
    write_start(robot, q, v, {**still, **motion})
    return q


def skeleton(robot: CompiledRobot, motion: Motion) -> np.ndarray:
    """(F, S, 2, 3) m: every body's origin joined to its parent's, the last body of a chain with its centre of mass, and
    at the end the payload's body with the payload site. See residual_mpc.models.drawing.Skeletal."""
    import mujoco

    model, q = robot.model, positions(robot, motion)
    data = mujoco.MjData(model)
    body, at = robot.payload
    parents = np.asarray(model.body_parentid)
    loose = set(model.jnt_bodyid[model.jnt_type == int(mujoco.mjtJoint.mjJNT_FREE)].tolist())
    joined = [b for b in range(1, model.nbody) if b not in loose]
    last = [b for b in range(1, model.nbody) if b not in parents and b != body]
    frames = []
    for row in q:
        data.qpos[:] = row
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        tool = data.xpos[body] + data.xmat[body].reshape(3, 3) @ at
        limbs = [(data.xpos[parents[b]], data.xpos[b]) for b in joined]
        ends = [(data.xpos[b], data.xipos[b]) for b in last]
        frames.append(np.array([*limbs, *ends, (data.xpos[body], tool)]))
    whole = np.stack(frames)
    long = np.linalg.norm(whole[:, :, 1] - whole[:, :, 0], axis=-1).max(axis=0) > SHORT
    long[-1] = True  # the tool is where the trail is, wherever it sits
    return whole[:, long]
