"""What a robot can be driven with, and how it is measured: from the runs that were diagnosed, or from its model."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from residual_mpc.errors import BadInput
from residual_mpc.models import optional
from residual_mpc.models.protocol import Robot

USUAL_PERIOD = 0.02  # s
PERIOD_TOLERANCE = 1e-4  # relative accuracy of a measured period
USUAL_NOISE = 2e-3  # rad, m: of a robot that has no runs yet


@dataclass(frozen=True)
class DriveSetup:
    """low, high, home (nu,): limits of the commands and what leaves the robot where it is, in the order of actuators.

    period: s between rows. sigma: 1-sigma noise of each channel that is logged; start: where each begins. switches:
    whether motors may be switched off. dispersion: how much larger residuals are than noise (1: white noise alone).
    """

    actuators: tuple[str, ...]
    low: np.ndarray
    high: np.ndarray
    home: np.ndarray
    period: float
    sigma: Mapping[str, float]
    start: Mapping[str, float]
    switches: bool = False
    dispersion: float = 1.0

    @property
    def wheeled(self) -> bool:
        return set(self.actuators) == {"left", "right"}

    @property
    def reach(self) -> np.ndarray:
        """(nu,) how far a command may go from home to either side."""
        return np.minimum(self.high - self.home, self.home - self.low)


def setup_from_runs(
    document: Mapping[str, Any], robot: Robot, where: str, limits: Mapping[str, tuple[float, float]]
) -> DriveSetup:
    """From a diagnosis.json, driven as far as its runs were, or as the limits of some actuators say.

    Raises BadInput where it does not say how the runs were made, and for an actuator that the robot lacks.
    """
    made = document.get("setup")
    if not made:
        raise BadInput("this diagnosis does not record how its runs were driven", where, "diagnose the runs again")
    try:
        known = {a: (float(b["low"]), float(b["high"])) for a, b in made["commands"].items()}
        sigma, start = ({c: float(v) for c, v in made[key].items()} for key in ("sigma", "start"))
        period = _nominal_period(float(made["period"]))
        switches, dispersion = bool(made["switches"]), float(made["dispersion"])
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise BadInput(
            f"its record of how the runs were driven cannot be read: {error!r}", where, "diagnose the runs again"
        ) from error
    if set(known) != set(robot.actuators):
        raise BadInput("its commands are not those of this robot", where, "diagnose the runs again")
    _check_limits(robot, limits)
    low, high, home = _ranges(robot, {**known, **limits})
    return DriveSetup(robot.actuators, low, high, home, period, sigma, start, switches, dispersion)


def _nominal_period(period: float) -> float:
    """Rounded to three digits where that changes it by less than its accuracy: 0.0199999 s is 0.02, 1/30 s stays."""
    digits = float(f"{period:.3g}")
    return digits if abs(digits - period) <= PERIOD_TOLERANCE * period else period


def setup_from_model(robot: Robot, limits: Mapping[str, tuple[float, float]]) -> DriveSetup:
    """Of a robot without runs: limits by actuator, else those that its model states.

    Raises BadInput for an actuator with neither, and for one that the robot lacks.
    """
    _check_limits(robot, limits)
    known = {**optional.command_limits(robot), **limits}
    missing = [a for a in robot.actuators if a not in known]
    if missing:
        raise BadInput(
            f"no command limits are known for {', '.join(missing)}", robot.name,
            "set them with `limits={" + ", ".join(f'"{a}": (LOW, HIGH)' for a in missing) + "}`",
        )  # fmt: skip
    low, high, home = _ranges(robot, known)
    start = dict.fromkeys((s.position for s in robot.states), 0.0)
    joints = optional.actuator_joints(robot)
    for joint, kind, at in zip(joints, robot.command_kinds, home, strict=True):
        if kind == "position" and f"position.{joint}" in start:
            start[f"position.{joint}"] = float(at)
    return DriveSetup(robot.actuators, low, high, home, USUAL_PERIOD, dict.fromkeys(start, USUAL_NOISE), start)


def with_encoders(setup: DriveSetup, robot: Robot) -> tuple[DriveSetup, tuple[str, ...]]:
    """The setup with the wheels' encoders logged as well, and their channels; none where they are, or do not exist."""
    encoders = (f"velocity.{a}" for a in setup.actuators if setup.wheeled)
    added = tuple(c for c in encoders if c in robot.channels and c not in setup.sigma)
    noise = 0.02 * float(np.abs([setup.low, setup.high]).max())
    return replace(setup, sigma={**setup.sigma, **dict.fromkeys(added, noise)}), added


def _check_limits(robot: Robot, limits: Mapping[str, tuple[float, float]]) -> None:
    for actuator, (low, high) in limits.items():
        if actuator not in robot.actuators:
            raise BadInput(
                f"unknown actuator {actuator!r}", "`limits`", f"the actuators are {', '.join(robot.actuators)}"
            )
        if not (np.isfinite([low, high]).all() and low < high):
            raise BadInput(
                f"the limits of {actuator} must be two finite numbers, the lower one first, got {low} and {high}",
                "`limits`", "the commands of the plan go as far as these limits",
            )  # fmt: skip


def _ranges(robot: Robot, known: Mapping[str, tuple[float, float]]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(nu,) each: lower and upper limits of the commands, and home: the middle for a position servo, rest for what
    drives or pushes (where rest is allowed)."""
    low, high = (np.array([known[a][i] for a in robot.actuators]) for i in (0, 1))
    middle = 0.5 * (low + high)
    servo = [k == "position" for k in robot.command_kinds]
    return low, high, np.where(servo, middle, np.where((low < 0) & (high > 0), 0.0, middle))
