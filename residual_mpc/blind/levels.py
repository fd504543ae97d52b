"""The levels of the benchmark: how many effects a case has, and how rough its log is."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Level:
    """One level: a recipe that every family follows."""

    name: str
    effects: tuple[int, int]  # least and most number of strong effects
    background: float = 0.0  # strength of every other effect, as a share of a strong one
    rough: bool = False  # feedback motion, jitter, dropouts, coloured noise, quantisation
    noise: float = 1.0  # factor on the sensor noise
    unknown: bool = False  # one cause that no library names, in place of effects
    withheld: bool = False  # the candidate of the planted effect is taken away
    confounded: bool = False  # effects and runs are chosen so that a group is the right answer


LEVELS: dict[str, Level] = {
    level.name: level
    for level in (
        Level("single", (1, 1)),
        Level("double", (2, 2)),
        Level("hard", (2, 3), background=0.1, rough=True),
        Level("none", (0, 0)),
        Level("noisy_none", (0, 0), noise=4.0),
        Level("unknown", (0, 0), unknown=True),
        Level("withheld", (1, 1), withheld=True),
        Level("confounded", (1, 1), confounded=True),
    )
}
