"""A robot's channels in MuJoCo's state: a start written into it, and readings taken from it."""

from collections.abc import Iterable, Mapping

import numpy as np

from plants.mujoco_robot.simulation.gear_feedback import on_link_side
from plants.mujoco_robot.structure.compiled_robot import CompiledRobot


def write_start(robot: CompiledRobot, q: np.ndarray, v: np.ndarray, start: Mapping[str, np.ndarray]) -> None:
    """Set positions (B, nq) and velocities (B, nv) from the channels of the robot's states, (B,) each; wheels roll and
    closed chains are closed."""
    rolling = None if robot.base is None else robot.base.write(q, v, start)
    for j, joint in enumerate(robot.joints):
        if joint not in robot.passive:
            q[:, robot.places[j]] = start[f"position.{joint}"]
            v[:, robot.dofs[j]] = start[f"velocity.{joint}"]
    if rolling is not None:  # a speed that nobody measured starts as exactly 0: such a wheel rolls with the robot
        v[:, robot.dofs] = np.where(v[:, robot.dofs] == 0.0, rolling, v[:, robot.dofs])
    if robot.loops is not None:
        robot.loops.close(q, v)


def read_channels(robot: CompiledRobot, q: np.ndarray, v: np.ndarray, wanted: Iterable[str]) -> dict[str, np.ndarray]:
    """Channels (...) of positions (..., nq) and velocities (..., nv), on the logged side of the gears; may be views."""
    if robot.gears is not None:
        q, v = q.copy(), v.copy()
        on_link_side(robot, q, v)
    out = {}
    for channel in wanted:
        kind, name = channel.split(".", 1)
        if robot.base is not None and kind in ("pose", "twist"):
            out[channel] = robot.base.read(channel, q, v)
            continue
        j = robot.joints.index(name)
        out[channel] = q[..., robot.places[j]] if kind == "position" else v[..., robot.dofs[j]]
    return out
