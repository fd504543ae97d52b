"""Blind cases of the paper's SCALER arm: a closed chain behind six stiff, well damped position servos."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from plants.blind_families.arm.effects import ArmRobot, Draw, Place, draw_effect, target_of
from plants.blind_families.arm.family import ArmBench
from plants.blind_families.arm.faults import UNNAMED, UNNAMED_IN_TESTS
from plants.blind_families.arm.setting import Setting
from plants.blind_families.bench import Habits
from plants.blind_families.case import Drawn, choose, first_case, make
from plants.blind_families.planting import Plantings, confounded
from plants.blind_families.scaler.effects import PLANTINGS
from plants.blind_families.scaler.model import CARRIED
from plants.blind_families.scaler.setting import draw_setting
from plants.scaler_arm.kinematics.geometry import MOTORS
from residual_mpc.blind.commanded_motion import CommandedMotion
from residual_mpc.blind.levels import Level
from residual_mpc.blind.records import Answer

HABITS = Habits(
    unnamed=UNNAMED,
    unnamed_in_tests=UNNAMED_IN_TESTS,
    flaws={},
    beyond="",
    pairs=(),
    changing=(),
    first=(0.05, 0.3),
    tries=6,
    most=0.5,
)
_ATTEMPTS = 40  # draws of effects before a level is given up


@dataclass(frozen=True)
class ScalerBench:
    """See ``bench.Bench``; what the serial arms' bench does for any arm is asked of it."""

    setting: Setting
    effects: tuple[str, ...]
    flaws: tuple[str, ...] = ()
    habits: Habits = HABITS
    always: tuple[str, ...] = ()
    described: tuple[str, ...] = ()
    rest: float = 0.0

    @property
    def _arms(self) -> ArmBench:
        return ArmBench(self.setting, self.effects, self.flaws, self.habits)

    @property
    def robot(self) -> ArmRobot:
        return self.setting.robot

    @property
    def plantings(self) -> Plantings[ArmRobot, Draw, Place]:
        return PLANTINGS

    @property
    def traits(self) -> tuple[str, ...]:
        return self._arms.traits

    @property
    def notes(self) -> dict[str, Any]:
        return {"names": list(MOTORS), "actuators": "position"}

    def draw(self, effect: str, rng: np.random.Generator) -> Draw:
        return draw_effect(effect, len(MOTORS), rng, PLANTINGS)

    def beside(self, draw: Draw, first: Draw) -> Draw:
        return self._arms.beside(draw, first)

    def target(self, draw: Draw) -> str | None:
        return target_of(draw, MOTORS, CARRIED)

    def plant(self, robot: ArmRobot, draw: Draw, strength: float) -> tuple[ArmRobot, dict[str, float]]:
        return PLANTINGS[draw.effect].plant(robot, draw, strength)

    def ratio(self, robot: ArmRobot, horizon: float | None = None) -> float:
        return self._arms.ratio(robot, horizon)

    def left(self, robot: ArmRobot) -> Callable[[ArmRobot], tuple[float, float]]:
        return self._arms.left(robot)

    def unnamed(self, cause: str, rng: np.random.Generator) -> Callable[[float], ArmRobot]:
        return self._arms.unnamed(cause, rng)

    def flawed(self, rng: np.random.Generator) -> Callable[[float], tuple[ArmRobot, ArmRobot]]:
        return self._arms.flawed(rng)

    def changing(self, draw: Draw, rng: np.random.Generator) -> tuple[str, Callable[[float], ArmRobot]]:
        return self._arms.changing(draw, rng)

    def write(self, robot: ArmRobot, clean: bool, rng: np.random.Generator, folder: Path) -> bool:
        return self._arms.write(robot, clean, rng, folder)

    def play(self, robot: ArmRobot, motion: CommandedMotion, rng: np.random.Generator, name: str, folder: Path) -> bool:
        return self._arms.play(robot, motion, rng, name, folder)


class ScalerFamily:
    """The SCALER arm, at the levels that need nothing but effects and causes.

    No case is ``withheld``: behind these servos nearly every effect has a stand-in among the others, and which share of
    its gap each removes is not measured yet.
    """

    name = "scaler"
    levels = ("single", "double", "hard", "none", "noisy_none", "unknown", "confounded")

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
        effects: tuple[str, ...] = (str(rng.choice(list(confounded(PLANTINGS)))),)
    else:
        effects = choose(PLANTINGS, level, rng)
    setting = draw_setting(level, rng)
    return None if setting is None else ScalerBench(setting, effects)


FAMILY = ScalerFamily()
