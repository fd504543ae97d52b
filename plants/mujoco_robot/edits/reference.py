"""Typical sizes of a robot's parts, for scaling."""

import numpy as np

from plants.mujoco_robot.structure.compiled_robot import CompiledRobot

PLAY = 0.25  # of what a wheel may have: 0.008 to 0.13 rad between an arm's motor and link


def reference(robot: CompiledRobot, kind: str, slot: str | None) -> float:
    """See Robot.reference."""
    m = robot.model
    if kind == "inertia":
        inertia = m.dof_M0[robot.dofs]
        return float(np.median(inertia) if slot is None else inertia[robot.joints.index(slot)])
    if kind == "mass":
        body = robot.payload[0] if slot is None or slot not in robot.links else robot.links.index(slot) + 1
        return float(max(m.body_mass[body], 0.1 * m.body_mass[1:].sum() / (m.nbody - 1)))
    if kind == "play":
        return PLAY
    if kind == "length":
        return float(max(np.linalg.norm(m.body_pos[1:], axis=1).mean(), 1e-3))
    return 1.0
