"""A closed-loop run filmed: the reference, and the robot with the nominal and with the corrected controller."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from residual_mpc.models.drawing import Motion
from residual_mpc.models.protocol import Robot
from residual_mpc.report.evidence.evidence import Array, Clip
from residual_mpc.report.motion.film import PLANAR, draw, drives
from residual_mpc.report.motion.ghosts import Ghosts
from residual_mpc.report.motion.ink import CORRECTED, MEASURED, PREDICTED

FRAMES = 97  # of a whole path
INKS = (replace(MEASURED, name="reference"), replace(PREDICTED, name="nominal"), CORRECTED)

Signals = Mapping[str, Array]  # channel -> (n,)


def film_drive(robot: Robot, t: Array, reference: Signals, nominal: Signals, corrected: Signals) -> Clip | None:
    """t (n,) s. None where the reference leaves a position of the robot open, or the robot's shape is not known."""
    wanted = PLANAR if drives(robot) else tuple(s.position for s in robot.states)
    if not all(c in motion for c in wanted for motion in (reference, nominal, corrected)):
        return None
    instants = np.linspace(float(t[0]), float(t[-1]), FRAMES)

    def motion(signals: Signals) -> Motion:
        return {c: np.interp(instants, t, signals[c]) for c in wanted}

    seconds = float(t[-1] - t[0])
    ghosts = Ghosts(motion(reference), motion(nominal), motion(corrected), (), seconds)
    drawn = draw(robot, ghosts, inks=INKS)
    if drawn is None:
        return None
    frames, still, _ = drawn
    return Clip(("closed loop",), "", 0.0, 0.0, 0.0, frames, still, seconds)
