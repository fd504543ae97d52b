"""Logged runs of a robot, read, matched with the models that they were recorded with, and audited."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from residual_mpc.api.display import brief, page
from residual_mpc.api.robot import NominalRobot
from residual_mpc.api.run_models import RunModels
from residual_mpc.errors import BadInput
from residual_mpc.files import write_atomically
from residual_mpc.logs.audit import audit, with_incidents
from residual_mpc.logs.finding import Finding
from residual_mpc.logs.mended import mended
from residual_mpc.logs.readers.read import read_runs as read_tables
from residual_mpc.logs.run import Run
from residual_mpc.models.facts import check_columns, facts_of
from residual_mpc.models.protocol import Robot
from residual_mpc.models.refuted import NOTHING, refuted_by
from residual_mpc.models.robot_file import noise_over
from residual_mpc.models.wheel_sizes import implausible_sizes
from residual_mpc.report.words.numbers import count

if TYPE_CHECKING:
    from pandas import DataFrame

Paths = str | Path | Sequence[str | Path]


@dataclass(frozen=True, eq=False)
class Runs:
    """models[i] is the nominal model of runs[i], which differs where a variant of the robot file matches; noise:
    1-sigma of each channel for which the robot file states one, channel unit; findings: of the reader and the audit;
    paths: as they were given."""

    runs: tuple[Run, ...]
    models: tuple[Robot, ...]
    noise: dict[str, float]
    findings: tuple[Finding, ...]
    paths: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.runs)

    def __iter__(self) -> Iterator[Run]:
        return iter(self.runs)

    def __getitem__(self, i: int) -> Run:
        return self.runs[i]

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(run.name for run in self.runs)

    def to_frame(self) -> "DataFrame":
        """All samples of all runs: `run`, `t` (s since the run's start) and the runs' columns."""
        import pandas as pd

        frames = [pd.DataFrame({"run": run.name, "t": run.t, **run.columns}) for run in self.runs]
        return pd.concat(frames, ignore_index=True)

    def save(self, file: str | Path) -> Path:
        """Write all runs to one CSV table of the log format, which `read_runs` reads back."""
        write_atomically(Path(file), self.to_frame().to_csv(index=False))
        return Path(file)

    def lines(self) -> list[str]:
        """The runs in words."""
        seconds = [float(run.t[-1] - run.t[0]) for run in self.runs]
        return [
            f"{count(len(self.runs), 'run')}, {sum(seconds):.4g} s in total",
            *(f"  {r.name:<28} {s:8.2f} s  {len(r.t):7d} samples" for r, s in zip(self.runs, seconds, strict=True)),
        ]

    def __str__(self) -> str:
        return "\n".join(self.lines())

    def __repr__(self) -> str:
        return brief(self, str(self))

    def _repr_html_(self) -> str:
        return page(self.lines())


def read_runs(robot: NominalRobot, paths: Paths) -> Runs:
    """Read and audit runs of a robot; `t` is the time at which a sample was taken, where that can be told.

    Args:
        robot: names the columns and, by its variants, the settings.
        paths: a file, folder or pattern, or several.

    Raises:
        BadInput: a table that cannot be read or does not fit the robot, with the file, the row and the column.
    """
    given = listed(paths)
    result = read_tables(given, robot.file)
    made = RunModels(robot)
    models = [made.of(run.name) for run in result.runs]
    runs, mends = mended(result.runs, [model.channels for model in models])
    check_columns(runs, models)
    refuted = refuted_by(robot.model, runs)
    if refuted != NOTHING:
        made = RunModels(robot, refuted)
        models = [made.of(run.name) for run in runs]
    names = [run.name for run in runs]
    sizes = implausible_sizes(robot.file, names)
    shapes = [overlap.finding() for overlap in refuted.overlaps]
    facts = facts_of(robot.model)
    runs = with_incidents(runs, facts)
    findings = (*sizes, *result.findings, *mends, *shapes, *audit(runs, facts))
    noise = noise_over(robot.file, names)
    return Runs(runs, tuple(models), noise, findings, given)


def usable(runs: Runs) -> Runs:
    """The runs. Raises BadInput where the audit forbids using them."""
    worst = next((f for f in runs.findings if f.severity == "error"), None)
    if worst is not None:
        raise BadInput(worst.message, worst.where, worst.remedy)
    return runs


def listed(paths: Paths) -> tuple[str, ...]:
    """One path or several, as texts."""
    return (str(paths),) if isinstance(paths, str | Path) else tuple(str(p) for p in paths)
