"""`make bench`: where the time of a diagnosis goes: stages, and rows x steps x seconds per step of its replays.

python -m benchmarks.profile [--robot wheeled] [--robot "small arm"] [--robot arm] [--case FOLDER ...]

A row is one window under one hypothesis. Seconds are processor time of one diagnosis in one process; they depend on the
machine, their shares and the number of steps do not. FOLDER: a robot.toml and its runs.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from time import process_time
from typing import Any
from unittest.mock import patch

import click
import numpy as np

from benchmarks.diagnosis import draw

ROBOTS = {  # family, level, first seed, joints
    "wheeled": ("wheeled", "double", 0, None),
    "small arm": ("arm", "single", 41, 2),
    "arm": ("arm", "double", 60, 6),
}
BEGINS = {  # what `diagnose` reports -> the stage that begins there
    "splitting the runs into windows": "windows and noise",
    "taking a first look": "first look",
    "searching for effects": "search",
    "searching over windows of": "search, longer",
    "testing each effect by removing it": "removal of effects",
    "comparing with alternative explanations": "rivals",
    "fitting on all windows": "last fit",
    "evaluating on the held-out windows": "held-out windows",
    "looking for a law in what is left": "laws",
    "analysing the remaining error": "remainder",
    "attributing the gap to the stages": "description",
}


@dataclass
class Stage:
    """s of processor time, and of that in replays, which simulated so many rows and steps."""

    seconds: float = 0.0
    replays: float = 0.0
    rows: int = 0
    steps: int = 0


@dataclass
class Clock:
    """Adds up the stages as a diagnosis reports them."""

    stages: dict[str, Stage] = field(default_factory=lambda: {"read": Stage()})
    now: str = "read"
    last: float = field(default_factory=process_time)

    def progress(self, text: str, done: float) -> None:
        """What `diagnose` calls."""
        self.enter(next((stage for begin, stage in BEGINS.items() if text.startswith(begin)), self.now))

    def enter(self, stage: str) -> None:
        """A stage begins, or goes on."""
        at = process_time()
        self.stages[self.now].seconds += at - self.last
        self.now, self.last = stage, at
        self.stages.setdefault(stage, Stage())

    def counted(self, work: Callable[..., np.ndarray]) -> Callable[..., np.ndarray]:
        """The replay of a block of windows, counted."""

        def replay(data: Any, block: Any, settings: Any, nudge: Any) -> np.ndarray:
            begin = process_time()
            found = work(data, block, settings, nudge)
            stage = self.stages[self.now]
            rows = settings.rows * (block.where.stop - block.where.start)
            stage.replays += process_time() - begin
            stage.rows += rows
            stage.steps += rows * (block.drive.steps + block.drive.lead)
            return found

        return replay


@click.command()
@click.option("--robot", "robots", multiple=True, type=click.Choice(list(ROBOTS)), help="[default: all]")
@click.option("--case", "folders", multiple=True, type=click.Path(exists=True, path_type=Path, file_okay=False))
def profile(robots: tuple[str, ...], folders: tuple[Path, ...]) -> None:
    """Print a table for each robot."""
    os.environ["LOKY_MAX_CPU_COUNT"] = "1"  # replays in other processes would not be counted
    for folder in folders:
        click.echo(table(folder.name, *measured(folder)))
    with tempfile.TemporaryDirectory() as place:
        for robot in robots or (() if folders else tuple(ROBOTS)):
            family, level, seed, joints = ROBOTS[robot]
            click.echo(table(robot, *measured(draw(family, level, seed, joints, Path(place) / robot))))


def measured(case: Path) -> tuple[Clock, tuple[str, ...]]:
    """The stages of one diagnosis, and what it names."""
    import residual_mpc as rm
    from residual_mpc.diagnosis.diagnose import diagnose
    from residual_mpc.diagnosis.options import Options
    from residual_mpc.diagnosis.predict import replay
    from residual_mpc.learning.batch.network_learner import LEARNERS

    clock = Clock()
    robot = rm.load_robot(case / "robot.toml")
    logged = rm.read_runs(robot, case)
    with patch.object(replay, "_predict_block", clock.counted(replay._predict_block)):
        made = diagnose(
            logged.runs, logged.models, dict(robot.file.noise), robot.file.tunable, Options(),
            np.random.default_rng(0), clock.progress, LEARNERS,
        )  # fmt: skip
    clock.enter(clock.now)
    return clock, tuple(str(c.term) for c in made.diagnosis.causes)


def table(robot: str, clock: Clock, named: tuple[str, ...]) -> str:
    """One line for each stage, as shares of the processor time."""
    whole = sum(s.seconds for s in clock.stages.values())
    lines = [
        f"\n{robot}: names {', '.join(named) or 'nothing'}; {whole:.1f} s here",
        f"  {'stage':<20}{'of all':>8}{'replays':>9}{'rows':>10}{'steps a row':>13}{'us a step':>11}",
    ]
    total = Stage()
    for stage in clock.stages.values():
        total.seconds += stage.seconds
        total.replays += stage.replays
        total.rows += stage.rows
        total.steps += stage.steps
    for name, s in (*clock.stages.items(), ("all", total)):
        lines.append(
            f"  {name:<20}{s.seconds / whole:>8.0%}{s.replays / whole:>9.0%}{s.rows:>10}"
            f"{s.steps / max(s.rows, 1):>13.0f}{1e6 * s.replays / max(s.steps, 1):>11.2f}"
        )
    return "\n".join(lines)


if __name__ == "__main__":
    profile()
