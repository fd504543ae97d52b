"""The command's way to the actuator, for a batch: delay, dead zone, a user's own, lag."""

from collections.abc import Mapping

import numpy as np

from residual_mpc.effects.actuator import lagged_sequence
from residual_mpc.effects.command import dead_zone_step, delayed_sequence
from residual_mpc.effects.library import PLUGGED
from residual_mpc.effects.ops import NUMPY
from residual_mpc.effects.plugged import present, through_commands


def command_chain(
    effects: Mapping[str, Mapping[str, np.ndarray]], u: np.ndarray, lead: int, dt: float, dead_zone: np.ndarray
) -> np.ndarray:
    """What the actuators see after the lead: (B, K, nu) from u (B, lead + K, nu).

    dead_zone (nu,) bool: the actuators whose dead zone acts on the command itself; a position servo's acts on its
    error, which only the robot knows.
    """
    if "command_delay" in effects:
        u = delayed_sequence(effects["command_delay"]["delay"], u, dt)
    if "dead_zone" in effects and dead_zone.any():
        width = np.where(dead_zone, effects["dead_zone"]["width"], 0.0)[:, None, :]
        u, _ = dead_zone_step(NUMPY, {"width": width}, (), u, dt)
    for effect, p in present(PLUGGED, effects, "command"):
        u = through_commands(effect, p, u, dt)
    if "actuator_lag" not in effects:
        return u[:, lead:]
    return lagged_sequence(effects["actuator_lag"]["time_constant"], u, dt)[:, lead:]
