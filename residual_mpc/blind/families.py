"""The families of truths, found through the entry point group ``residual_mpc.blind_families``."""

from __future__ import annotations

from importlib.metadata import entry_points
from pathlib import Path
from typing import Protocol, runtime_checkable
from zlib import crc32

import numpy as np

from residual_mpc.blind.commanded_motion import CommandedMotion
from residual_mpc.blind.levels import LEVELS, Level
from residual_mpc.blind.records import Answer
from residual_mpc.errors import BadInput

GROUP = "residual_mpc.blind_families"


class HiddenRobot(Protocol):
    """The robot of one case, drawn anew, that can be driven once more."""

    @property
    def answer(self) -> Answer: ...

    def play(self, motion: CommandedMotion, rng: np.random.Generator, name: str, folder: Path) -> bool:
        """Log ``motion``, by the sensors and under the noise of the case's runs, as the run ``name`` in ``folder``.

        False, and nothing written, where the robot runs away.
        """
        ...


class Family(Protocol):
    """A kind of robot whose truth can be drawn, at every level unless it is ``Levelled``."""

    name: str

    def draw_case(self, level: Level, seed: int, rng: np.random.Generator, folder: Path) -> HiddenRobot:
        """``write_case``, with the robot that made the runs in place of its answer alone."""
        ...

    def write_case(self, level: Level, seed: int, rng: np.random.Generator, folder: Path) -> Answer:
        """Draw a truth, write what a user would have (robot file, model, runs) to ``folder``, return it."""
        ...


@runtime_checkable
class Levelled(Protocol):
    """A family that cannot draw every level. Optional."""

    @property
    def levels(self) -> tuple[str, ...]:
        """Names of the levels that it draws."""
        ...


def family_names() -> tuple[str, ...]:
    """Names of all installed families, sorted."""
    return tuple(sorted({point.name for point in entry_points(group=GROUP)}))


def load_family(name: str) -> Family:
    """The installed family called ``name``; ``BadInput`` where there is none."""
    for point in entry_points(group=GROUP):
        if point.name == name:
            family: Family = point.load()
            return family
    known = ", ".join(family_names()) or "none installed"
    raise BadInput(f"unknown family {name!r}", "--family", f"known families: {known}")


def levels_of(family: Family) -> tuple[str, ...]:
    """Names of the levels that ``family`` draws."""
    return family.levels if isinstance(family, Levelled) else tuple(LEVELS)


def load_level(name: str) -> Level:
    """The level called ``name``; ``BadInput`` where there is none."""
    if name not in LEVELS:
        raise BadInput(f"unknown level {name!r}", "--level", f"known levels: {', '.join(LEVELS)}")
    return LEVELS[name]


def make_case(family: str, level: str, seed: int, folder: Path | str) -> Answer:
    """Write one case to ``folder/case`` and return its answer, which is written nowhere.

    The same family, level and seed give the same files. Raises ``BadInput`` for a level that the family does not draw.
    """
    kind, recipe, rng, case = _prepared(family, level, seed, folder)
    return kind.write_case(recipe, seed, rng, case)


def make_hidden_robot(family: str, level: str, seed: int, folder: Path | str) -> HiddenRobot:
    """Write the case anew, and return its robot."""
    kind, recipe, rng, case = _prepared(family, level, seed, folder)
    return kind.draw_case(recipe, seed, rng, case)


def _prepared(
    family: str, level: str, seed: int, folder: Path | str
) -> tuple[Family, Level, np.random.Generator, Path]:
    case, recipe, kind = Path(folder) / "case", load_level(level), load_family(family)
    if level not in levels_of(kind):
        drawn = ", ".join(levels_of(kind))
        raise BadInput(f"family {family} has no level {level!r}", "--level", f"its levels: {drawn}")
    case.mkdir(parents=True, exist_ok=True)
    # the names of family and level enter the stream, so that equal seeds share nothing across them
    key = [seed, crc32(family.encode()), crc32(level.encode())]
    return kind, recipe, np.random.default_rng(key), case
