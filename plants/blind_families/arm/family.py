"""Blind cases of serial arms of 2 to 7 hinges, drawn at random."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from plants.blind_families.arm.effects import LONG_PLANTINGS, PLANTINGS, ArmRobot, Draw, Place, draw_effect, target_of
from plants.blind_families.arm.faults import (
    BEYOND,
    CHANGING,
    FLAWS,
    PAIRS,
    UNNAMED,
    UNNAMED_IN_TESTS,
    caused,
    changing,
    flawed,
)
from plants.blind_families.arm.files import write_clean, write_played, write_robot, write_runs
from plants.blind_families.arm.runs import play_robot
from plants.blind_families.arm.servo_effects import POSITION_SERVOS, SERVO_PLANTINGS
from plants.blind_families.arm.setting import Setting, draw_setting, left, ratio
from plants.blind_families.bench import Habits
from plants.blind_families.case import Drawn, choose_for, first_case, make
from plants.blind_families.planting import Plantings, confounded, needed
from residual_mpc.blind.commanded_motion import CommandedMotion
from residual_mpc.blind.levels import LEVELS, Level
from residual_mpc.blind.records import Answer

HABITS = Habits(
    unnamed=UNNAMED,
    unnamed_in_tests=UNNAMED_IN_TESTS,
    flaws=FLAWS,
    beyond=BEYOND,
    pairs=PAIRS,
    changing=CHANGING,
    first=(0.1, 0.4),
    tries=5,
    most=0.5,
)
_ATTEMPTS = 60  # draws of effects before a level is given up


@dataclass(frozen=True)
class ArmBench:
    """See ``bench.Bench``."""

    setting: Setting
    effects: tuple[str, ...]
    flaws: tuple[str, ...] = ()
    habits: Habits = HABITS
    always: tuple[str, ...] = ()
    described: tuple[str, ...] = ()
    rest: float = 0.0
    known: Plantings[ArmRobot, Draw, Place] = field(default_factory=lambda: PLANTINGS)

    @property
    def robot(self) -> ArmRobot:
        return self.setting.robot

    @property
    def plantings(self) -> Plantings[ArmRobot, Draw, Place]:
        return self.known

    @property
    def traits(self) -> tuple[str, ...]:
        return ("arm", "drops" if self.setting.drops else "no_drops")

    @property
    def notes(self) -> dict[str, Any]:
        arm = self.robot.truth.arm
        return {"joints": len(arm.joints), "actuators": arm.kind}

    def draw(self, effect: str, rng: np.random.Generator) -> Draw:
        return draw_effect(effect, len(self.robot.truth.arm.joints), rng, self.known)

    def beside(self, draw: Draw, first: Draw) -> Draw:
        return draw if draw.joint is None else replace(draw, joint=first.joint)

    def target(self, draw: Draw) -> str | None:
        joints = self.robot.truth.arm.joints
        return target_of(draw, joints, [f"link{i + 1}" for i in range(len(joints))])

    def plant(self, robot: ArmRobot, draw: Draw, strength: float) -> tuple[ArmRobot, dict[str, float]]:
        return self.known[draw.effect].plant(robot, draw, strength)

    def ratio(self, robot: ArmRobot, horizon: float | None = None) -> float:
        """Always over a second: no level of arms is slow."""
        return ratio(robot, self.setting)

    def left(self, robot: ArmRobot) -> Callable[[ArmRobot], tuple[float, float]]:
        return left(robot, self.setting)

    def unnamed(self, cause: str, rng: np.random.Generator) -> Callable[[float], ArmRobot]:
        return caused(cause, self.robot, float(self.setting.motion.t[-1]), rng)

    def flawed(self, rng: np.random.Generator) -> Callable[[float], tuple[ArmRobot, ArmRobot]]:
        return flawed(self.flaws[0], self.robot, float(self.setting.motion.t[-1]), rng)

    def changing(self, draw: Draw, rng: np.random.Generator) -> tuple[str, Callable[[float], ArmRobot]]:
        motion = self.setting.motion
        return changing(draw, self.robot, len(motion.on), float(motion.t[-1]), rng)

    def write(self, robot: ArmRobot, clean: bool, rng: np.random.Generator, folder: Path) -> bool:
        happened = play_robot(robot, self.setting.motion)
        if happened is None:
            return False
        write_robot(self.setting, bool(rng.random() < 0.5), folder)
        write_runs(robot, happened, self.setting, rng, folder)
        if clean:
            write_clean(robot, happened, self.setting, rng, folder.parent / "clean")
        return True

    def play(self, robot: ArmRobot, motion: CommandedMotion, rng: np.random.Generator, name: str, folder: Path) -> bool:
        return write_played(robot, self.setting, motion, rng, name, folder)


class ArmFamily:
    """Serial arms with position, velocity or torque actuators; no case is ``slow``, since their servos hold them."""

    name = "arm"
    levels = tuple(name for name, level in LEVELS.items() if not (level.slow or level.base))

    def write_case(self, level: Level, seed: int, rng: np.random.Generator, folder: Path) -> Answer:
        """Draw a truth and write what its user would have."""
        return self.draw_case(level, seed, rng, folder).answer

    def draw_case(self, level: Level, seed: int, rng: np.random.Generator, folder: Path) -> Drawn[ArmRobot, Draw]:
        """As ``write_case``, with the robot."""

        def attempt() -> Drawn[ArmRobot, Draw] | None:
            bench = _bench(level, rng)
            return None if bench is None else make(self.name, bench, level, seed, rng, folder)

        return first_case(attempt, _ATTEMPTS, f"arm case of level {level.name} with seed {seed}")


def _bench(level: Level, rng: np.random.Generator) -> ArmBench | None:
    effects: tuple[str, ...]
    flaws: tuple[str, ...]
    known = SERVO_PLANTINGS if level.servo else LONG_PLANTINGS if level.long else PLANTINGS
    if level.confounded:
        effects, flaws = (str(rng.choice(list(confounded(PLANTINGS)))),), ()
    else:
        effects, flaws = choose_for(known, HABITS, level, rng)
    setting = draw_setting(level, rng)
    kind = None if setting is None else setting.robot.truth.arm.kind
    if needed(known, effects, POSITION_SERVOS) and kind != "position":
        return None
    if setting is None or ((level.pairs or level.changed) and kind != "position"):
        return None  # the remaining gap needs whole runs, and only position servos keep to the planned motion
    # stretches with the motor off would tell the members of the group apart
    return None if level.confounded and setting.drops else ArmBench(setting, effects, flaws, known=known)


FAMILY = ArmFamily()
