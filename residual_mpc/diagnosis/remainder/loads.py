"""Joint torques from the actuators of a model, along its own motion."""

from collections.abc import Mapping

import numpy as np

from residual_mpc.diagnosis.data.dataset import Block, Dataset
from residual_mpc.diagnosis.predict.replay import begin_earlier, beyond, earliest, on_windows, start_states
from residual_mpc.effects.laws import LOADED
from residual_mpc.models import optional
from residual_mpc.models.protocol import Robot
from residual_mpc.models.settings import Settings

Loads = Mapping[str, np.ndarray]  # joint -> (W, M) N m (N)


def joint_loads(data: Dataset, settings: Settings) -> Loads:
    """The actuators' torques at every sample, by the model (settings, one row); 0 where padded. Only of joints that can
    have a law of their load.
    """
    out: dict[str, np.ndarray] = {}
    for block in data.blocks:
        for joint, load in _of_block(data, block, settings.of_group(block.group)).items():
            out.setdefault(joint, np.zeros(data.t.shape))[block.where] = load
    return out


def _of_block(data: Dataset, block: Block, settings: Settings) -> Loads:
    robot, here = block.robot, data.t[block.where]
    shares = _shares(robot)
    if not shares:
        return {}
    start = {k: v[0] for k, v in start_states(data, block, settings).items()}
    wanted = tuple(f"output.{a}" for a in shares)
    early = earliest(block, settings)  # (1, W) s
    drive = begin_earlier(block.drive, early, beyond(block, settings))
    nodes = robot.replay(start, drive, on_windows(data, block, settings), wanted)
    since = np.nan_to_num(here) + early[0][:, None]  # (W, M) s from the first node
    at = np.arange(drive.steps + 1) * drive.dt
    out: dict[str, np.ndarray] = {}
    for a, (joint, ratio) in shares.items():
        given = ratio * np.nan_to_num(nodes[f"output.{a}"])
        load = np.stack([np.interp(t, at, y) for t, y in zip(since, given, strict=True)])
        out[joint] = out.get(joint, 0.0) + np.where(np.isfinite(here), load, 0.0)
    return out


def _shares(robot: Robot) -> dict[str, tuple[str, float]]:
    """Actuator -> its joint, and the torque there per unit of its output."""
    hosts = robot.slots(LOADED)
    if not hosts:
        return {}
    joints = optional.actuator_joints(robot)
    every = zip(robot.actuators, joints, optional.gear_ratios(robot), strict=True)
    return {a: (joint, ratio) for a, joint, ratio in every if joint in hosts}
