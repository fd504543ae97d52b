"""The setpoints of position servos in a steady motion, including what holds the load."""

from collections.abc import Mapping

import numpy as np

from plants.mujoco_robot.structure.compiled_robot import CompiledRobot


def steady_setpoints(robot: CompiledRobot, motion: Mapping[str, np.ndarray]) -> np.ndarray:
    """See residual_mpc.models.optional.SteadySetpoints: with gain k, damping d and a force f through a gear g, a servo
    at the joint angle q has the setpoint u = g q + (d g qd + f / g) / k, since its force is k (u - g q) - d g qd.
    """
    m = robot.model
    constant, stiff, damp = m.actuator_biasprm[:, 0], -m.actuator_biasprm[:, 1], -m.actuator_biasprm[:, 2]
    plain = (stiff > 0.0) & (m.actuator_gainprm[:, 0] == stiff) & (constant == 0.0) & (m.actuator_dyntype == 0)
    if robot.settings or not plain.any():  # variants have stiffnesses of their own
        return np.full((max((len(x) for x in motion.values()), default=0), m.nu), np.nan)
    q, v = (_joints(robot, motion, kind) for kind in ("position", "velocity"))  # (W, joints)
    gear, at = m.actuator_gear[:, 0], robot.driven
    force = _forces(robot, q, v)[:, at] / gear
    more = np.divide(damp * gear * v[:, at] + force, stiff, out=np.full(force.shape, np.nan), where=plain)
    return np.asarray(gear * q[:, at] + more)


def _joints(robot: CompiledRobot, motion: Mapping[str, np.ndarray], kind: str) -> np.ndarray:
    """(W, joints); what is not known is at rest."""
    count = max((len(x) for x in motion.values()), default=0)
    rest = [robot.rest.get(f"{kind}.{j}", 0.0) for j in robot.joints]
    columns = [motion.get(f"{kind}.{j}", np.full(count, r)) for j, r in zip(robot.joints, rest, strict=True)]
    return np.stack([np.where(np.isfinite(c), c, r) for c, r in zip(columns, rest, strict=True)], axis=-1)


def _forces(robot: CompiledRobot, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """(W, joints) forces with which the joints keep these speeds: bias less passive forces, without friction. Of a
    closed chain, whose loops carry some of the load, those of the joints' damping alone."""
    import mujoco

    m = robot.model
    if robot.loops is not None:
        return np.asarray(m.dof_damping[robot.dofs] * v)
    data, out = mujoco.MjData(m), np.empty(q.shape)
    for w in range(len(q)):
        data.qpos[robot.places], data.qvel[robot.dofs] = q[w], v[w]
        mujoco.mj_fwdPosition(m, data)
        mujoco.mj_fwdVelocity(m, data)
        out[w] = (data.qfrc_bias - data.qfrc_passive)[robot.dofs]
    return out
