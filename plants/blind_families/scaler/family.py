"""Blind cases of the paper's SCALER arm: a closed chain behind six stiff, well damped position servos."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from plants.blind_families.arm.effects import PLANT, TYPICAL, ArmRobot, Draw, draw_effect
from plants.blind_families.arm.family import ArmBench, arm_clash
from plants.blind_families.arm.setting import Setting
from plants.blind_families.case import Drawn, Habits, choose, first_case, make
from plants.blind_families.scaler.model import CARRIED, FOREARM
from plants.blind_families.scaler.setting import draw_setting
from plants.scaler_arm.kinematics.geometry import MOTORS
from residual_mpc.blind.commanded_motion import CommandedMotion
from residual_mpc.blind.levels import LEVELS, Level
from residual_mpc.blind.records import Answer

HABITS = Habits(
    unnamed=("cogging", "dragging_cable", "warming_friction", "gusts"),
    first=(0.05, 0.3),
    tries=6,
    most=0.5,
    typical=TYPICAL,
)
_ATTEMPTS = 40  # draws of effects before a level is given up
_SENSED = ("sensor_delay", "sensor_bias", "sensor_outliers")
# what comes late by a little looks alike behind a servo that is damped this well: its own lag, more of its damping,
# and a rotor that is slow to start
_LATE = {"command_delay", "sensor_delay", "actuator_lag", "viscous_friction", "armature"}


def _clash(effects: tuple[str, ...]) -> bool:
    """Whether data could hardly tell the members apart, or one undoes another."""
    return arm_clash(effects) or len(_LATE & set(effects)) > 1


@dataclass(frozen=True)
class ScalerBench:
    """See ``case.Bench``; what the serial arms' bench does for any arm is asked of it."""

    setting: Setting
    effects: tuple[str, ...]
    habits: Habits = HABITS

    @property
    def _arms(self) -> ArmBench:
        return ArmBench(self.setting, self.effects, self.habits)

    @property
    def robot(self) -> ArmRobot:
        return self.setting.robot

    @property
    def faint(self) -> tuple[str, ...]:
        return self._arms.faint

    @property
    def traits(self) -> tuple[str, ...]:
        return self._arms.traits

    @property
    def notes(self) -> dict[str, Any]:
        return {"names": list(MOTORS), "actuators": "position"}

    def draw(self, effect: str, rng: np.random.Generator) -> Draw:
        draw = draw_effect(effect, len(MOTORS), rng)
        where = {"link_mass": FOREARM, "sensor_outliers": None}  # no candidate blames one encoder for outliers
        return replace(draw, joint=where.get(effect, draw.joint))

    def target(self, draw: Draw) -> str | None:
        """The name the contract gives to where the effect sits."""
        if draw.joint is None:
            return None
        if draw.effect == "link_mass":
            return CARRIED[draw.joint]
        return f"position.{MOTORS[draw.joint]}" if draw.effect in _SENSED else MOTORS[draw.joint]

    def plant(self, robot: ArmRobot, draw: Draw, strength: float) -> tuple[ArmRobot, dict[str, float]]:
        return PLANT[draw.effect](robot, draw, strength)

    def ratio(self, robot: ArmRobot) -> float:
        return self._arms.ratio(robot)

    def unnamed(self, cause: str, rng: np.random.Generator) -> Callable[[float], ArmRobot]:
        return self._arms.unnamed(cause, rng)

    def write(self, robot: ArmRobot, clean: bool, rng: np.random.Generator, folder: Path) -> bool:
        return self._arms.write(robot, clean, rng, folder)

    def play(self, robot: ArmRobot, motion: CommandedMotion, rng: np.random.Generator, name: str, folder: Path) -> bool:
        return self._arms.play(robot, motion, rng, name, folder)


class ScalerFamily:
    """The SCALER arm.

    No case is ``withheld``: behind these servos nearly every effect has a stand-in among the others, and which share of
    its gap each removes is not measured yet.
    """

    name = "scaler"
    levels = tuple(name for name, level in LEVELS.items() if not level.withheld)

    def write_case(self, level: Level, seed: int, rng: np.random.Generator, folder: Path) -> Answer:
        """Draw a truth and write what its user would have."""
        return self.draw_case(level, seed, rng, folder).answer

    def draw_case(self, level: Level, seed: int, rng: np.random.Generator, folder: Path) -> Drawn[ArmRobot, Draw]:
        """As ``write_case``, with the robot."""

        def attempt() -> Drawn[ArmRobot, Draw] | None:
            bench = _bench(level, rng)
            return None if bench is None else make(self.name, bench, level, seed, rng, folder)

        return first_case(attempt, _ATTEMPTS, f"SCALER case of level {level.name} with seed {seed}")


def _bench(level: Level, rng: np.random.Generator) -> ScalerBench | None:
    if level.confounded:  # no run has its motors off, so that nothing parts the two
        effects: tuple[str, ...] = (str(rng.choice(["command_delay", "sensor_delay"])),)
    else:
        effects = choose(sorted(PLANT), level, _clash, rng)
    setting = draw_setting(level, rng)
    return None if setting is None else ScalerBench(setting, effects)


FAMILY = ScalerFamily()
