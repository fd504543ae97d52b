"""Blind cases of serial arms of 2 to 7 hinges, drawn at random."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from plants.blind_families.arm.effects import PLANTINGS, ArmRobot, Draw, Place, draw_effect, target_of
from plants.blind_families.arm.files import write_clean, write_played, write_robot, write_runs
from plants.blind_families.arm.runs import play
from plants.blind_families.arm.setting import Setting, draw_setting, ratio
from plants.blind_families.arm.truth import ArmTruth
from plants.blind_families.case import Drawn, Habits, choose, first_case, make
from plants.blind_families.planting import Plantings, confounded
from residual_mpc.blind.commanded_motion import CommandedMotion
from residual_mpc.blind.levels import Level
from residual_mpc.blind.records import Answer

HABITS = Habits(
    unnamed=("cogging", "dragging_cable", "warming_friction", "gusts"),
    first=(0.1, 0.4),
    tries=5,
    most=0.5,
)
_ATTEMPTS = 60  # draws of effects before a level is given up


@dataclass(frozen=True)
class ArmBench:
    """See ``case.Bench``."""

    setting: Setting
    effects: tuple[str, ...]
    habits: Habits = HABITS

    @property
    def robot(self) -> ArmRobot:
        return self.setting.robot

    @property
    def plantings(self) -> Plantings[ArmRobot, Draw, Place]:
        return PLANTINGS

    @property
    def traits(self) -> tuple[str, ...]:
        return ("arm", "drops" if self.setting.drops else "no_drops")

    @property
    def notes(self) -> dict[str, Any]:
        arm = self.robot.truth.arm
        return {"joints": len(arm.joints), "actuators": arm.kind}

    def draw(self, effect: str, rng: np.random.Generator) -> Draw:
        return draw_effect(effect, len(self.robot.truth.arm.joints), rng)

    def target(self, draw: Draw) -> str | None:
        joints = self.robot.truth.arm.joints
        return target_of(draw, joints, [f"link{i + 1}" for i in range(len(joints))])

    def plant(self, robot: ArmRobot, draw: Draw, strength: float) -> tuple[ArmRobot, dict[str, float]]:
        return PLANTINGS[draw.effect].plant(robot, draw, strength)

    def ratio(self, robot: ArmRobot) -> float:
        return ratio(robot, self.setting)

    def unnamed(self, cause: str, rng: np.random.Generator) -> Callable[[float], ArmRobot]:
        truth, torque = self.setting.robot.truth, self.setting.robot.torque_rms
        n = len(torque)
        one = np.zeros(n)
        one[rng.integers(n)] = 1.0
        teeth = int(rng.integers(9, 26))
        blows = []
        for begin in np.arange(1.5, self.setting.motion.t[-1] - 1.0, 1.6):
            begin = float(begin + rng.uniform(0, 0.8))
            blows.append([begin, begin + float(rng.uniform(0.2, 0.7)), *(rng.normal(size=n) * torque)])

        def caused(s: float) -> ArmRobot:
            changed: ArmTruth
            if cause == "cogging":
                changed = replace(truth, cogging=2.0 * s * torque * one, cogging_teeth=teeth)
            elif cause == "dragging_cable":
                changed = replace(truth, cable=6.0 * s * torque * one)
            elif cause == "warming_friction":
                changed = replace(truth, warm_up=3.0 * s * torque * one)
            else:
                gusts = np.array(blows)
                gusts[:, 2:] *= 2.0 * s
                changed = replace(truth, gusts=gusts)
            return replace(self.setting.robot, truth=changed)

        return caused

    def write(self, robot: ArmRobot, clean: bool, rng: np.random.Generator, folder: Path) -> bool:
        happened = play(robot.truth, self.setting.motion)
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
    """Serial arms with position, velocity or torque actuators."""

    name = "arm"

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
    if level.confounded:
        effects: tuple[str, ...] = (str(rng.choice(list(confounded(PLANTINGS)))),)
    else:
        effects = choose(PLANTINGS, level, rng)
    setting = draw_setting(level, rng)
    # stretches with the motor off would tell the members of the group apart
    return None if setting is None or (level.confounded and setting.drops) else ArmBench(setting, effects)


FAMILY = ArmFamily()
