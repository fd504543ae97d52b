"""The arm as lines: for pictures of it, whichever engine moves it."""

import numpy as np

from plants.scaler_arm.kinematics.five_bar import coupling
from plants.scaler_arm.kinematics.forward import chain, posture
from plants.scaler_arm.kinematics.geometry import MOTORS, Arm
from residual_mpc.effects.ops import NUMPY
from residual_mpc.models.drawing import Motion


def skeleton(arm: Arm, motion: Motion) -> np.ndarray:
    """(F, S, 2, 3) m at motor angles `position.<motor>` (F,) rad: see residual_mpc.models.drawing.Skeletal."""
    frames = []
    for q in np.stack([motion[f"position.{m}"] for m in MOTORS], axis=-1):
        lines = links(arm, q)
        frames.append(np.concatenate([np.stack([line[:-1], line[1:]], axis=1) for line in lines]))
    return np.stack(frames)


def links(arm: Arm, q: np.ndarray) -> list[np.ndarray]:
    """The arm as lines to draw at q (6,) rad: crank a with rod b, then the way from the mount to the tool; (n, 3) m."""
    whole = chain(arm)
    at = posture(NUMPY, whole, list(q))
    end_a, end_f, c = coupling(NUMPY, whole.bar, q[1], q[2])
    out = np.array(at.out)

    def lift(point: tuple[float, float]) -> np.ndarray:
        return np.array([out[0] * point[0], out[1] * point[0], point[1]])

    loop = np.array([lift(whole.bar.pivot_a), lift(end_a), lift(c)])
    pivots = lift(whole.bar.pivot_a), lift(whole.bar.pivot_f)
    main = np.array([np.zeros(3), *pivots, lift(end_f), at.wrist_centre, at.tool])
    return [loop, np.array([lift(end_f), lift(c)]), main]
