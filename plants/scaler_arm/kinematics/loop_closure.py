"""From the state that a caller names to every joint of the arm, the loop closed."""

from dataclasses import dataclass

import numpy as np

from plants.scaler_arm.kinematics.five_bar import passive_rates
from plants.scaler_arm.kinematics.forward import chain, passive_angles
from plants.scaler_arm.kinematics.geometry import MOTORS, Arm
from plants.simulator import Reading
from residual_mpc.effects.ops import NUMPY
from residual_mpc.errors import BadInput

AXES = ("x", "y", "z")
CHANNELS = (
    *(f"position.{m}" for m in MOTORS),
    *(f"velocity.{m}" for m in MOTORS),
    *(f"tool.{axis}" for axis in AXES),  # m, where the tool point really is: no sensor of the paper's arm sees it
)


@dataclass(frozen=True)
class Joints:
    """Angles rad and rates rad/s of the motors (..., 6) and of the passive joints (..., 2), the loop closed."""

    motors: np.ndarray
    motor_rates: np.ndarray
    passive: np.ndarray
    rates: np.ndarray


def joints_at(at: Reading, arm: Arm) -> Joints:
    """All joints from the motors' channels in `at`; those that are not named are 0.

    Raises BadInput for a channel that is no motor's position or velocity, and for a pose beyond the joint limits.
    """
    settable = CHANNELS[: 2 * len(MOTORS)]
    unknown = sorted(set(at) - set(settable))
    if unknown:
        raise BadInput(
            f"unknown channels in the start: {', '.join(unknown)}", "scaler_arm", f"use {', '.join(settable)}"
        )
    q = np.array([at.get(f"position.{m}", 0.0) for m in MOTORS], dtype=np.float64)
    v = np.array([at.get(f"velocity.{m}", 0.0) for m in MOTORS], dtype=np.float64)
    for motor, angle, (low, high) in zip(MOTORS, q, arm.limits, strict=True):
        if not low - 1e-9 <= angle <= high + 1e-9:
            what = f"position.{motor} must start between {low} and {high} rad, got {angle}"
            raise BadInput(what, "scaler_arm")
    return closed(q, v, arm)


def closed(q: np.ndarray, v: np.ndarray, arm: Arm) -> Joints:
    """All joints from the motors' angles q (..., 6) rad and rates v (..., 6) rad/s."""
    a, f, rate_a, rate_f = q[..., 1], q[..., 2], v[..., 1], v[..., 2]
    rates = np.stack(passive_rates(NUMPY, chain(arm).bar, a, f, rate_a, rate_f), axis=-1)
    return Joints(q, v, passive_angles(q, arm), rates)


def at_posture(q: np.ndarray) -> dict[str, float]:
    """The start channels of motor angles q (6,) rad, at rest."""
    return {f"position.{m}": float(x) for m, x in zip(MOTORS, q, strict=True)}
