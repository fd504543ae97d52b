"""Closed-loop experiments by name: whoever installs a package with an entry point in this group adds one."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from difflib import get_close_matches
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, Literal, Protocol

from residual_mpc.errors import BadInput

GROUP = "residual_mpc.scenarios"
OWN_GROUP = "residual_mpc.own_scenarios"  # one entry: the function that runs a user's own robot
CONTROLLER_TYPES = ("mpc", "lqr")
Progress = Callable[[str, float], None]


class DoubtfulReference(UserWarning):
    """A reference that the robot can hardly follow, or that may be in other units."""


@dataclass(frozen=True)
class RunOptions:
    """seeds: how many plants; seed: of the first; out: folder for episodes, diagnosis and figures, None for none.
    Raises BadInput for an unknown controller, fewer than one seed, and a budget that is not positive.

    budget: s that a controller may take a sample before it has to do without; by default late samples are counted and
    nothing else, so that an experiment repeats on a busy machine.
    """

    controller: Literal["mpc", "lqr"] = "mpc"
    seeds: int = 10
    seed: int = 0
    out: Path | None = None
    budget: float = math.inf

    def __post_init__(self) -> None:
        if self.controller not in CONTROLLER_TYPES:
            remedy = f"use {' or '.join(CONTROLLER_TYPES)}"
            raise BadInput(f"unknown controller {self.controller!r}", "controller", remedy)
        if not isinstance(self.seeds, int) or self.seeds < 1:
            raise BadInput(f"there must be at least one seed, got {self.seeds}", "seeds", "give a whole number above 0")
        if not self.budget > 0.0:
            raise BadInput(f"the time limit must be positive, got {self.budget}", "budget", "give it in seconds")


class Scenario(Protocol):
    """A runnable experiment; its `run` returns the contract's `run` or `learn` object."""

    @property
    def name(self) -> str: ...

    @property
    def summary(self) -> str:
        """One line for the list."""
        ...

    def run(self, options: RunOptions, progress: Progress) -> dict[str, Any]: ...


def scenario_names() -> tuple[str, ...]:
    """Every name that `find_scenario` knows."""
    return tuple(sorted({e.name for e in entry_points(group=GROUP)}))


def find_own_scenario() -> Callable[..., dict[str, Any]]:
    """The function that runs a user's own robot. Raises BadInput if no installed package provides it."""
    for entry in entry_points(group=OWN_GROUP):
        found: Callable[..., dict[str, Any]] = entry.load()
        return found
    raise BadInput("no installed package runs a user's own robot", "", "install the package `scenarios`")


def find_scenario(name: str) -> Scenario:
    """Raises BadInput for a name that is not there."""
    for entry in entry_points(group=GROUP):
        if entry.name == name:
            found: Scenario = entry.load()
            return found
    close = get_close_matches(name, scenario_names(), 1)
    hint = f"did you mean {close[0]}?" if close else "run `residual-mpc run` to list the scenarios"
    raise BadInput(f"unknown scenario {name!r}", "", hint)
