"""Blind cases of a wheeled robot: two driven wheels, a localisation, sometimes encoders."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from plants.blind_families.case import Drawn, Habits, choose, first_case, make
from plants.blind_families.planting import Plantings, confounded
from plants.blind_families.wheeled.effects import PLANTINGS, Draw, Place, Rover, draw_effect
from plants.blind_families.wheeled.files import write_clean, write_played, write_robot, write_runs
from plants.blind_families.wheeled.setting import Setting, draw_setting, ratio
from residual_mpc.blind.commanded_motion import CommandedMotion
from residual_mpc.blind.levels import Level
from residual_mpc.blind.records import Answer

HABITS = Habits(
    unnamed=("eccentric_wheel", "one_sided_turning", "warming_up", "gusts"),
    first=(0.15, 0.5),
    tries=6,
    most=1.0,
)
_ATTEMPTS = 40  # draws of effects before a level is given up


@dataclass(frozen=True)
class WheeledBench:
    """See ``case.Bench``; straight: every run is a straight line."""

    setting: Setting
    effects: tuple[str, ...]
    straight: bool
    habits: Habits = HABITS

    @property
    def robot(self) -> Rover:
        return self.setting.rover

    @property
    def plantings(self) -> Plantings[Rover, Draw, Place]:
        return PLANTINGS

    @property
    def traits(self) -> tuple[str, ...]:
        encoders = "encoders" if self.setting.encoders else "no_encoders"
        return ("wheeled", encoders, *(("straight",) if self.straight else ()))

    @property
    def notes(self) -> dict[str, Any]:
        return {}

    def draw(self, effect: str, rng: np.random.Generator) -> Draw:
        draw = draw_effect(effect, self.setting.encoders, rng)
        # a slope along the line, so that nothing gives it away
        return replace(draw, angle=float(rng.choice([0.0, np.pi]))) if self.straight else draw

    def target(self, draw: Draw) -> str | None:
        return draw.target

    def plant(self, robot: Rover, draw: Draw, strength: float) -> tuple[Rover, dict[str, float]]:
        return PLANTINGS[draw.effect].plant(robot, draw, strength)

    def ratio(self, robot: Rover) -> float:
        return ratio(robot, self.setting)

    def unnamed(self, cause: str, rng: np.random.Generator) -> Callable[[float], Rover]:
        left = float(rng.uniform(0.6, 1.0))
        blows = []
        for begin in np.arange(1.5, 24.0, 1.7):
            blow = rng.normal(size=3)
            begin = float(begin + rng.uniform(0, 0.8))
            blows.append((begin, begin + float(rng.uniform(0.3, 0.9)), *(float(b) for b in blow)))

        def caused(s: float) -> Rover:
            truth = self.setting.rover.truth
            if cause == "eccentric_wheel":
                truth = replace(truth, eccentric=(0.5 * s, 0.5 * s * left))
            elif cause == "one_sided_turning":
                truth = replace(truth, one_sided=0.6 * s)
            elif cause == "warming_up":
                truth = replace(truth, warm_up=0.6 * s, warm_up_time=5.0)
            else:
                truth = replace(
                    truth, gusts=tuple((a, b, 0.4 * s * x, 0.4 * s * y, 0.8 * s * w) for a, b, x, y, w in blows)
                )
            return replace(self.setting.rover, truth=truth)

        return caused

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

    def write_case(self, level: Level, seed: int, rng: np.random.Generator, folder: Path) -> Answer:
        """Draw a truth and write what its user would have."""
        return self.draw_case(level, seed, rng, folder).answer

    def draw_case(self, level: Level, seed: int, rng: np.random.Generator, folder: Path) -> Drawn[Rover, Draw]:
        """As ``write_case``, with the robot."""

        def attempt() -> Drawn[Rover, Draw] | None:
            return make(self.name, _bench(level, rng), level, seed, rng, folder)

        return first_case(attempt, _ATTEMPTS, f"wheeled case of level {level.name} with seed {seed}")


def _bench(level: Level, rng: np.random.Generator) -> WheeledBench:
    if not level.confounded:
        effects = choose(PLANTINGS, level, rng)
        return WheeledBench(draw_setting(level, effects, False, rng), effects, False)
    ways = confounded(PLANTINGS)
    drawn = str(rng.choice(list(ways)))
    straight, by = ways[drawn].straight, ways[drawn].by
    effects = (by.name if by else drawn,)
    return WheeledBench(replace(draw_setting(level, effects, straight, rng), encoders=False), effects, straight)


FAMILY = WheeledFamily()
