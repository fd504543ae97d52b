"""The setpoints that the actuators of a robot have reached at an instant, as far as its measured motion shows them.

Whatever delays or limits a command is warmed up from there. From the command itself, a slow lag or rate limit would
start at the setpoint that it is still to reach.
"""

from collections.abc import Mapping

import numpy as np

from residual_mpc.diagnosis.data.local_fit import local_fit
from residual_mpc.diagnosis.data.signals import Signal
from residual_mpc.models import optional
from residual_mpc.models.protocol import Robot


def reached(
    robot: Robot, i: int, at: np.ndarray, signals: Mapping[tuple[int, str], Signal], moves: bool = True
) -> np.ndarray:
    """(W, actuators) in units of the commands, NaN where nothing shows it: the measured speed of a wheel, and the
    setpoint of a position servo that sustains the measured motion of its joint; unmeasured joints are taken to be at
    rest, and all of them where they are not said to move. i: the run's number in the signals; at (W,) s."""
    motion = {}
    for state in robot.states:
        signal = signals.get((i, state.position))
        if signal is None:
            continue
        fit = local_fit(signal.t, at)
        motion[state.position] = fit.value(signal.y)
        if state.velocity is not None and moves:
            rate = signals.get((i, state.velocity))
            slope = fit.slope(signal.y) if rate is None else local_fit(rate.t, at).value(rate.y)
            motion[state.velocity] = np.nan_to_num(slope)
    nothing = np.full(len(at), np.nan)
    out = optional.steady_setpoints(robot, motion) if motion else np.full((len(at), len(robot.actuators)), np.nan)
    own = [motion.get(f"position.{joint}", nothing) for joint in optional.actuator_joints(robot)]
    out = np.where(np.isfinite(np.stack(own, axis=-1)), out, np.nan)
    for k, (joint, kind) in enumerate(zip(optional.actuator_joints(robot), robot.command_kinds, strict=True)):
        speed = signals.get((i, f"velocity.{joint}")) if kind == "speed" else None
        if speed is not None:
            out[:, k] = local_fit(speed.t, at).value(speed.y)
    return out
