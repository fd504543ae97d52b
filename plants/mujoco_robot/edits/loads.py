"""What each joint carries at most, and what its motors give."""

import numpy as np

from plants.mujoco_robot.structure.compiled_robot import CompiledRobot
from plants.mujoco_robot.structure.force_limits import largest_forces

POSES = 128  # in which a joint's largest inertia is looked for


def largest_torques(robot: CompiledRobot) -> np.ndarray:
    """(joints,) N m (N), the most that the model lets the actuators of each joint give; inf where it sets no limit."""
    m = robot.model
    force = largest_forces(m.actuator_forcerange)
    for i, kind in enumerate(robot.command_kinds):
        if kind == "torque" and m.actuator_ctrllimited[i]:
            force[i] = min(force[i], abs(m.actuator_gainprm[i, 0]) * np.abs(m.actuator_ctrlrange[i]).max())
    torques = np.zeros(len(robot.joints))
    np.add.at(torques, robot.driven, force * np.abs(m.actuator_gear[:, 0]))
    torques[np.setdiff1d(np.arange(len(torques)), robot.driven)] = np.inf
    numbers = [m.joint(j).id for j in robot.joints]
    own = np.where(m.jnt_actfrclimited[numbers], np.abs(m.jnt_actfrcrange[numbers]).max(axis=1), np.inf)
    return np.asarray(np.minimum(torques, own))


def largest_inertias(robot: CompiledRobot) -> np.ndarray:
    """(joints,) kg m^2 (kg), what each joint carries about its axis, without rotors, in the pose where it is most.

    An open chain is looked at over its joints' ranges; a closed one at rest, its passive joints moving along.
    """
    import mujoco

    m, dof = robot.model, robot.dofs
    data, most = mujoco.MjData(m), np.zeros(len(dof))
    moved = np.zeros((len(dof), m.nv))
    moved[np.arange(len(dof)), dof] = 1.0
    poses = _poses(robot)
    if robot.loops is not None:
        own = moved[[j in robot.passive for j in robot.joints]]
        q = np.repeat(poses, len(dof), axis=0)
        robot.loops.close(q, moved)
        poses = q[:1]
        moved[[j in robot.passive for j in robot.joints]] = own
    whole = np.zeros((m.nv, m.nv))
    for pose in poses:
        data.qpos[:] = pose
        mujoco.mj_kinematics(m, data)
        mujoco.mj_comPos(m, data)
        mujoco.mj_crb(m, data)
        mujoco.mj_fullM(m, data, whole)
        bodies = whole - np.diag(m.dof_armature)
        most = np.maximum(most, np.einsum("ji,ik,jk->j", moved, bodies, moved))
    return np.maximum(most, 1e-12)


def _poses(robot: CompiledRobot) -> np.ndarray:
    """(n, nq): the model's own pose, and of an open chain others that fill the joints' ranges evenly."""
    from scipy.stats.qmc import Halton

    m = robot.model
    if robot.loops is not None:
        return np.asarray(m.qpos0[None])
    poses = np.repeat(m.qpos0[None], POSES, axis=0)
    shares = Halton(len(robot.joints), scramble=False).random(POSES)
    for k, (joint, place) in enumerate(zip(robot.joints, robot.places.tolist(), strict=True)):
        rest = float(m.qpos0[place])
        turn = (rest, rest) if joint in robot.sliding else (rest - np.pi, rest + np.pi)
        low, high = robot.limits.get(joint, turn)
        poses[1:, place] = low + shares[1:, k] * (high - low)
    return poses
