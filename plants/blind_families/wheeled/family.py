"""Blind cases of a wheeled robot: two driven wheels, a localisation, sometimes encoders."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from plants.blind_families.bench import Habits
from plants.blind_families.case import Drawn, choose_for, first_case, make
from plants.blind_families.planting import Plantings, confounded
from plants.blind_families.wheeled.effects import (
    BASE_PLANTINGS,
    EVERY,
    LONG_PLANTINGS,
    PLANTINGS,
    SIDES,
    Draw,
    Place,
    Rover,
    draw_effect,
)
from plants.blind_families.wheeled.faults import BEYOND, CHANGING, FLAWS, PAIRS, SLOW, caused, changing, flawed
from plants.blind_families.wheeled.files import write_clean, write_played, write_robot, write_runs
from plants.blind_families.wheeled.setting import Setting, draw_setting, left, ratio
from residual_mpc.blind.commanded_motion import CommandedMotion
from residual_mpc.blind.levels import LEVELS, Level
from residual_mpc.blind.records import Answer

HABITS = Habits(
    unnamed=("one_sided_turning", "warming_up", "gusts", "drifting_gyro", "relocations"),
    unnamed_in_tests=("flipping_castor", "carpet_nap", "magnetic_heading", "hot_motors"),
    flaws=FLAWS,
    beyond=BEYOND,
    pairs=PAIRS,
    changing=CHANGING,
    first=(0.15, 0.5),
    tries=6,
    most=1.0,
)
_ATTEMPTS = 40  # draws of effects before a level is given up


@dataclass(frozen=True)
class WheeledBench:
    """See ``bench.Bench``; straight: every run is a straight line."""

    setting: Setting
    effects: tuple[str, ...]
    straight: bool
    flaws: tuple[str, ...] = ()
    habits: Habits = HABITS
    always: tuple[str, ...] = ()
    described: tuple[str, ...] = ()
    rest: float = 0.0  # gap over the noise floor that the robot has without any effect
    known: Plantings[Rover, Draw, Place] = field(default_factory=lambda: PLANTINGS)

    @property
    def robot(self) -> Rover:
        return self.setting.rover

    @property
    def plantings(self) -> Plantings[Rover, Draw, Place]:
        return self.known

    @property
    def traits(self) -> tuple[str, ...]:
        encoders = "encoders" if self.setting.encoders else "no_encoders"
        return ("wheeled", encoders, *(("straight",) if self.straight else ()))

    @property
    def notes(self) -> dict[str, Any]:
        return {"rest": self.rest} if self.rest else {}

    def draw(self, effect: str, rng: np.random.Generator) -> Draw:
        draw = draw_effect(effect, self.setting.encoders, rng)
        # a slope along the line, so that nothing gives it away
        return replace(draw, angle=float(rng.choice([0.0, np.pi]))) if self.straight else draw

    def beside(self, draw: Draw, first: Draw) -> Draw:
        at_wheels = draw.target in SIDES
        return replace(draw, target=first.target if first.target in SIDES else None) if at_wheels else draw

    def target(self, draw: Draw) -> str | None:
        return draw.target

    def plant(self, robot: Rover, draw: Draw, strength: float) -> tuple[Rover, dict[str, float]]:
        return EVERY[draw.effect].plant(robot, draw, strength)

    def ratio(self, robot: Rover, horizon: float | None = None) -> float:
        found = ratio(robot, self.setting, horizon)
        return float(np.sqrt(max(found**2 - self.rest**2, 0.0))) if self.rest else found

    def left(self, robot: Rover) -> Callable[[Rover], tuple[float, float]]:
        return left(robot, self.setting)

    def unnamed(self, cause: str, rng: np.random.Generator) -> Callable[[float], Rover]:
        return caused(cause, self.robot, rng)

    def flawed(self, rng: np.random.Generator) -> Callable[[float], tuple[Rover, Rover]]:
        return flawed(self.flaws[0], self.robot, rng)

    def changing(self, draw: Draw, rng: np.random.Generator) -> tuple[str, Callable[[float], Rover]]:
        return changing(draw, self.robot, [(plan.name, float(plan.t[-1])) for plan in self.setting.plans], rng)

    def write(self, robot: Rover, clean: bool, rng: np.random.Generator, folder: Path) -> bool:
        write_robot(self.setting, bool(rng.random() < 0.5), folder)
        write_runs(robot, self.setting, rng, folder)
        if clean:
            write_clean(robot, self.setting, rng, folder.parent / "clean")
        return True

    def play(self, robot: Rover, motion: CommandedMotion, rng: np.random.Generator, name: str, folder: Path) -> bool:
        write_played(robot, self.setting, motion, rng, name, folder)
        return True


class WheeledFamily:
    """Differential drives of many sizes."""

    name = "wheeled"
    levels = tuple(name for name, level in LEVELS.items() if not level.servo)

    def write_case(self, level: Level, seed: int, rng: np.random.Generator, folder: Path) -> Answer:
        """Draw a truth and write what its user would have."""
        return self.draw_case(level, seed, rng, folder).answer

    def draw_case(self, level: Level, seed: int, rng: np.random.Generator, folder: Path) -> Drawn[Rover, Draw]:
        """As ``write_case``, with the robot."""

        def attempt() -> Drawn[Rover, Draw] | None:
            return make(self.name, _bench(level, rng), level, seed, rng, folder)

        return first_case(attempt, _ATTEMPTS, f"wheeled case of level {level.name} with seed {seed}")


def _known_at(level: Level) -> Plantings[Rover, Draw, Place]:
    return LONG_PLANTINGS if level.long else BASE_PLANTINGS if level.base else PLANTINGS


def _shown_at(level: Level) -> Plantings[Rover, Draw, Place]:
    return {name: PLANTINGS[name] for name in SLOW} if level.slow else _known_at(level)


def _bench(level: Level, rng: np.random.Generator) -> WheeledBench:
    if not level.confounded:
        effects, flaws = choose_for(_shown_at(level), HABITS, level, rng)
        return WheeledBench(draw_setting(level, effects, False, rng), effects, False, flaws, known=_known_at(level))
    ways = confounded(PLANTINGS)
    drawn = str(rng.choice(list(ways)))
    straight, by = ways[drawn].straight, ways[drawn].by
    effects = (by.name if by else drawn,)
    return WheeledBench(replace(draw_setting(level, effects, straight, rng), encoders=False), effects, straight)


FAMILY = WheeledFamily()
