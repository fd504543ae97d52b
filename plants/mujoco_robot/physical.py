"""What may be added to a model, at least and at most, as its own masses, inertias and motors have it."""

from typing import TYPE_CHECKING

import numpy as np

from plants.mujoco_robot.compile import NO_LIMIT
from residual_mpc.effects.library import BY_NAME

if TYPE_CHECKING:
    import mujoco

    from plants.mujoco_robot.robot import MujocoRobot

MOST_PLAY = 0.6  # rad
SOFTEST = 20.0  # rad^2/s^2: a spring in units of the inertia that it carries, on which an arm would hang like a rope
MOST_ROTOR = 3.0  # of what a joint carries: more would be felt as nothing but rotor
MOST_ON_SMALLEST = 10.0  # of what the smallest driven joint carries, whose rotor is often the larger part
QUICK = 100.0  # rad/s^2 (m/s^2) that robots' motors commonly give their own rotors at full torque, or more
SLUGGISH = 5.0  # rad/s^2 (m/s^2) below which no motor would be built into an arm
KEPT = 0.1  # of a mass, at least, where mass is taken away
KEPT_ROTOR = 0.05
POSES = 128  # in which a joint's largest inertia is looked for

Bounds = tuple[np.ndarray, np.ndarray]


def physical_bounds(robot: "MujocoRobot", effect: str, parameter: str, slot: str | None) -> tuple[float, float]:
    """The limits of a parameter at one slot, or of one value for all slots (None).

    Of several settings that were merged, nothing may become negative in any, and the widest upper limit counts.
    """
    found = [_of_one(part, effect, parameter, slot) for part in robot.settings or (robot,)]
    return max(low for low, _ in found), max(high for _, high in found)


def _of_one(robot: "MujocoRobot", effect: str, parameter: str, slot: str | None) -> tuple[float, float]:
    low, high = _of_slots(robot, effect, parameter)
    if slot is not None and len(low) > 1:
        at = robot.slots(effect).index(slot)
        return float(low[at]), float(high[at])
    rotor = BY_NAME[effect].parameter(parameter).quantity == "rotor inertia"
    most = _rotor_of_all(robot) if rotor and len(low) > 1 else float(high.min())
    return float(low.max()), most


def _of_slots(robot: "MujocoRobot", effect: str, parameter: str) -> Bounds:
    """(slots,) each, or (1,) where one limit holds for all."""
    m, dof = robot.model, robot.dofs
    free = np.full(1, np.inf)
    match BY_NAME[effect].parameter(parameter).quantity:
        case "dry friction":
            return -m.dof_frictionloss[dof], robot.torques
        case "viscous damping":
            return -m.dof_damping[dof], np.full(len(dof), np.inf)
        case "rotor inertia":
            return (KEPT_ROTOR - 1.0) * m.dof_armature[dof], _rotors(robot)
        case "tool mass":
            return (KEPT - 1.0) * m.body_mass[[robot.payload[0]]], np.full(1, _moving_mass(m))
        case "link mass":
            return (KEPT - 1.0) * m.body_mass[1:], np.full(m.nbody - 1, _moving_mass(m))
        case "gear play":
            return -free, np.full(1, MOST_PLAY)
        case "gear stiffness":
            stiffness = SOFTEST * np.array([robot.reference("inertia", j) for j in robot.geared])
            return (stiffness, np.full(len(stiffness), np.inf)) if len(stiffness) else (-free, free)
        case "link length" if robot.lengths is not None and robot.lengths.lines:
            lengths = np.array([length for _, length in robot.lengths.lines.values()])
            return (KEPT - 1.0) * lengths, 2.0 * lengths
    return -free, free


def _moving_mass(model: "mujoco.MjModel") -> float:
    """kg of all bodies that a joint moves."""
    return float(model.body_mass[model.body_weldid != 0].sum())


def _rotors(robot: "MujocoRobot") -> np.ndarray:
    """(joints,) kg m^2, the largest rotor that may be added at each joint alone.

    A wrist's geared motor may carry less than its own rotor: it may have one that its torque still accelerates, or,
    where that is not known, one as large as a typical joint of the arm.
    """
    carried, torque, driven = robot.inertias, robot.torques, np.unique(robot.driven)
    motor = np.where(np.isfinite(torque), torque / SLUGGISH, MOST_ROTOR * np.median(carried[driven]))
    return np.maximum(np.maximum(MOST_ROTOR * carried, motor), _rotor_of_all(robot))


def _rotor_of_all(robot: "MujocoRobot") -> float:
    """kg m^2, the largest rotor that may be added at every joint alike.

    It has to be possible at the smallest driven joint: a shoulder's would freeze the wrists. One as large as the
    model's own largest is possible everywhere.
    """
    carried, torque, driven = robot.inertias, robot.torques, np.unique(robot.driven)
    rotor = robot.model.dof_armature[robot.dofs]
    small = driven[np.argmin(carried[driven])]
    motor = np.where(np.isfinite(torque), torque / QUICK, 0.0)
    typical = np.maximum(MOST_ROTOR * carried, motor)[driven].min()
    return float(max(typical, MOST_ON_SMALLEST * carried[small] + rotor[small], rotor.max()))


def largest_torques(robot: "MujocoRobot") -> np.ndarray:
    """(joints,) N m (N), the most that the model lets the actuators of each joint give; inf where it sets no limit."""
    m = robot.model
    force = np.abs(m.actuator_forcerange).max(axis=1)
    force = np.where(force < 0.5 * NO_LIMIT, force, np.inf)
    for i, kind in enumerate(robot.command_kinds):
        if kind == "torque" and m.actuator_ctrllimited[i]:
            force[i] = min(force[i], abs(m.actuator_gainprm[i, 0]) * np.abs(m.actuator_ctrlrange[i]).max())
    torques = np.zeros(len(robot.joints))
    np.add.at(torques, robot.driven, force * np.abs(m.actuator_gear[:, 0]))
    torques[np.setdiff1d(np.arange(len(torques)), robot.driven)] = np.inf
    numbers = [m.joint(j).id for j in robot.joints]
    own = np.where(m.jnt_actfrclimited[numbers], np.abs(m.jnt_actfrcrange[numbers]).max(axis=1), np.inf)
    return np.asarray(np.minimum(torques, own))


def largest_inertias(robot: "MujocoRobot") -> np.ndarray:
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


def _poses(robot: "MujocoRobot") -> np.ndarray:
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
