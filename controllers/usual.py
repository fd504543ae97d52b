"""Settings for an arm that nobody has tuned: from its ranges and what its actuators can do."""

import numpy as np

from controllers.settings import Limits, MpcSettings, Soft, Weights
from residual_mpc.export.augmented import Augmented

JOINT, TOOL = 0.02, 0.005  # rad (m of a joint that slides) and m: an error that costs as much as a usual change
SPEED = 2.0  # rad/s (m/s), at which a position servo's command may move
SWEEP = 0.2  # s, in which the command of a motor or a velocity servo may cross its reach
CHANGE = {"position": 0.05, "velocity": 0.1, "torque": 0.05}  # of the reach: a usual change in one sample
FAINT = 100.0  # times the reach: commands themselves cost next to nothing
MARGIN = 0.02  # rad or m, inside of a joint's range
PRICE = 1000.0  # a unit, of passing it
PUSH = 100.0  # price of twice the force that a servo can give


def usual_settings(model: Augmented) -> MpcSettings:
    """Weights by the reach of each command, limits of commands (a motor's are its torques) and of their rates, and soft
    ones of the joints' ranges and the servos' forces. For a robot that drives, the rover's.
    """
    at = model.stepped
    if not at.rates:
        return MpcSettings()
    low, high = (np.array(side) for side in zip(*at.reach, strict=True))
    kinds, width = model.robot.command_kinds, np.ptp(np.array(at.reach), axis=1)
    typical = [CHANGE[k] * (1.0 if k == "position" else w) for k, w in zip(kinds, width.tolist(), strict=True)]
    rate = [SPEED if k == "position" else w / SWEEP for k, w in zip(kinds, width.tolist(), strict=True)]
    soft = tuple(
        Soft(c, x + MARGIN, y - MARGIN, PRICE)
        for c, (x, y) in zip(at.poses, at.spans, strict=True)
        if y - x < 2.0 * np.pi - 1e-9 and y - x > 4.0 * MARGIN
    )
    soft += tuple(
        Soft(f"effort.{a}", -most, most, PUSH / most, PUSH / most**2)
        for a, kind, most in zip(at.commands, kinds, at.strengths, strict=True)
        if kind != "torque" and np.isfinite(most)
    )
    error = (TOOL,) * len(at.outputs) if at.outputs else (JOINT,) * len(at.poses)
    return MpcSettings(
        weights=Weights(error, tuple((FAINT * width).tolist()), tuple(typical)),
        limits=Limits(tuple(low.tolist()), tuple(high.tolist()), tuple(rate), soft),
    )
