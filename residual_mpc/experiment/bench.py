"""What a robot can be driven with, and how it is measured: from the runs that were diagnosed, or from its model."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from residual_mpc.errors import BadInput
from residual_mpc.models.protocol import Robot

USUAL_PERIOD = 0.02  # s
USUAL_NOISE = 2e-3  # rad, m: of a robot that has no runs yet


@dataclass(frozen=True)
class Bench:
    """low, high, home (nu,): limits of the commands and what leaves the robot where it is, in the order of actuators.

    period: s between rows. sigma: 1-sigma noise of each channel that is logged; start: where each begins. switches:
    whether motors may be switched off. dispersion: how much larger residuals are than noise (1: white noise alone).
    """

    actuators: tuple[str, ...]
    kinds: tuple[str, ...]
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


def bench_of(document: Mapping[str, Any], robot: Robot, where: str) -> Bench:
    """From a diagnosis.json. Raises BadInput where it does not say how the runs were made."""
    made = document.get("setup")
    if not made or set(made["commands"]) != set(robot.actuators):
        raise BadInput(
            "it does not say how its runs were driven" if not made else "its commands are not this robot's",
            where, "diagnose the runs anew",
        )  # fmt: skip
    low, high = (np.array([made["commands"][a][side] for a in robot.actuators]) for side in ("low", "high"))
    return Bench(
        robot.actuators, robot.command_kinds, low, high, _home(robot.command_kinds, low, high), made["period"],
        made["sigma"], made["start"], made["switches"], made["dispersion"],
    )  # fmt: skip


def bench_of_model(robot: Robot, limits: Mapping[str, tuple[float, float]]) -> Bench:
    """Of a robot without runs: limits by actuator, else those that its model states. Raises BadInput without either."""
    stated: Mapping[str, tuple[float, float]] = getattr(robot, "command_limits", {})
    known = {**stated, **limits}
    missing = [a for a in robot.actuators if a not in known]
    if missing:
        raise BadInput(
            f"nothing says how far {', '.join(missing)} may be driven", robot.name,
            " ".join(f"--limit {a}=LOW:HIGH" for a in missing),
        )  # fmt: skip
    low, high = (np.array([known[a][i] for a in robot.actuators]) for i in (0, 1))
    home = _home(robot.command_kinds, low, high)
    start = dict.fromkeys((s.position for s in robot.states), 0.0)
    joints = getattr(robot, "actuator_joints", robot.actuators)
    for joint, kind, at in zip(joints, robot.command_kinds, home, strict=True):
        if kind == "position" and f"position.{joint}" in start:
            start[f"position.{joint}"] = float(at)
    return Bench(
        robot.actuators, robot.command_kinds, low, high, home, USUAL_PERIOD, dict.fromkeys(start, USUAL_NOISE), start
    )


def within(bench: Bench, limits: Mapping[str, tuple[float, float]]) -> Bench:
    """The bench with other limits for some actuators. Raises BadInput for an actuator that it lacks."""
    low, high = bench.low.copy(), bench.high.copy()
    for actuator, (a, b) in limits.items():
        if actuator not in bench.actuators:
            raise BadInput(f"no actuator is called {actuator!r}", "--limit", f"they are {', '.join(bench.actuators)}")
        k = bench.actuators.index(actuator)
        low[k], high[k] = a, b
    return replace(bench, low=low, high=high, home=_home(bench.kinds, low, high))


def with_encoders(bench: Bench, robot: Robot) -> tuple[Bench, tuple[str, ...]]:
    """The bench with the wheels' encoders logged as well, and their channels; none where they are, or do not exist."""
    encoders = (f"velocity.{a}" for a in bench.actuators if bench.wheeled)
    added = tuple(c for c in encoders if c in robot.channels and c not in bench.sigma)
    noise = 0.02 * float(np.abs([bench.low, bench.high]).max())
    return replace(bench, sigma={**bench.sigma, **dict.fromkeys(added, noise)}), added


def _home(kinds: Sequence[str], low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """(nu,) the middle for a position servo, rest for what drives or pushes (where rest is allowed)."""
    middle = 0.5 * (low + high)
    return np.where([k == "position" for k in kinds], middle, np.where((low < 0) & (high > 0), 0.0, middle))
