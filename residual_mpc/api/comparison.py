"""What changed between two sets of runs of one robot."""

import shlex
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from residual_mpc.api.display import brief, page
from residual_mpc.api.effect_names import effect_names, possible_effects
from residual_mpc.api.given import check_given, check_seconds
from residual_mpc.api.robot import NominalRobot
from residual_mpc.api.run_models import RunModels
from residual_mpc.api.runs import Runs
from residual_mpc.api.servos import with_motors_changed
from residual_mpc.comparison.compare import compare as run_comparison
from residual_mpc.comparison.document import to_document
from residual_mpc.comparison.prepare import ComparisonInput
from residual_mpc.comparison.settings import ComparisonSettings
from residual_mpc.diagnosis.options import Options
from residual_mpc.diagnosis.search.measured_commands import not_commanded
from residual_mpc.errors import BadInput
from residual_mpc.files import write_atomically, write_json
from residual_mpc.logs.finding import Finding
from residual_mpc.logs.run import Run
from residual_mpc.models.refuted import refuted_by
from residual_mpc.models.robot_file import measured_over, noise_over
from residual_mpc.report.comparison import comparison_lines, comparison_page, comparison_sentence

if TYPE_CHECKING:
    from pandas import DataFrame

Progress = Callable[[str, float], None]  # what is done, and the share of it all that is behind

ANSWER, REPORT = "comparison.json", "report.html"


@dataclass(frozen=True, eq=False)
class Comparison:
    """document: the content of comparison.json (contract, section 8)."""

    document: dict[str, Any]

    @property
    def verdict(self) -> str:
        """ "same", "changed", "partial" or "unknown"."""
        return str(self.document["verdict"])

    @property
    def changes(self) -> list[dict[str, Any]]:
        """The effects that differ, each with target, probability, and its numbers before, after and between."""
        return list(self.document["changes"])

    @property
    def gap(self) -> dict[str, Any]:
        """Of the model fitted to the runs before: on them, on those after, and on those with the changes."""
        return dict(self.document["gap"])

    def to_frame(self) -> "DataFrame":
        """One row a number of a change: before, after, and the change with its 95 % interval (low, high)."""
        import pandas as pd

        columns = ["effect", "target", "probability", "parameter", "before", "after", "change", "low", "high", "unit"]
        rows = [
            (c["effect"], c["target"], c["probability"], name, n["before"], n["after"], n["change"]["value"],
             *n["change"]["ci95"], n["change"]["unit"])
            for c in self.changes
            for name, n in c["parameters"].items()
        ]  # fmt: skip
        return pd.DataFrame(rows, columns=columns)

    def save(self, folder: str | Path) -> Path:
        """Write comparison.json and report.html."""
        out = Path(folder)
        write_json(out / ANSWER, self.document)
        write_atomically(out / REPORT, comparison_page(self.document))
        return out

    def lines(self) -> list[str]:
        """The comparison in words."""
        return comparison_lines(self.document)

    def __str__(self) -> str:
        return "\n".join(self.lines())

    def __repr__(self) -> str:
        return brief(self, str(self))

    def _repr_html_(self) -> str:
        return page(self.lines(), self.to_frame())


def compare(
    robot: NominalRobot,
    before: Runs,
    after: Runs,
    *,
    only: Sequence[str] = (),
    without: Sequence[str] = (),
    horizon: float = 1.0,
    seed: int = 0,
    out: str | Path | None = None,
    command: str = "",
    progress: Progress = lambda stage, done: None,
) -> Comparison:
    """Name what differs between two sets of runs of one robot.

    One account of the robot, the effects that a diagnosis of the runs before names, is fitted to both sets, so that
    what the model gets wrong cancels.

    Args:
        only, without: effects to consider alone, or to leave out (contract, section 6).
        horizon: length of a window, s.
        out: folder that the answer is written to.
        command: the call as the report prints it; by default the command line that does the same.

    Raises:
        BadInput: runs that cannot be used or are in both sets, a set too short to tell how much runs of it differ, or
            an effect that does not exist or, in `only`, that the robot cannot have.
    """
    check_given(robot, before, after)
    check_seconds(horizon, "horizon")
    if not before.runs or not after.runs:
        raise BadInput("must name at least one run", "`after`" if before.runs else "`before`")
    settings = ComparisonSettings()
    _distinct(before, after)
    for runs, option in ((before, "`before`"), (after, "`after`")):
        _long_enough(runs, option, horizon, settings.contrast.unit)
    names = (*before.names, *after.names)
    made = RunModels(robot, refuted_by(robot.model, (*before.runs, *after.runs)))
    options = Options(
        horizon=horizon,
        only=possible_effects(only, "`only`", (*before.models, *after.models)),
        without=effect_names(without, "`without`"),
        without_because=not_commanded(robot.model, measured_over(robot.file, list(names))),
    )
    given = ComparisonInput(
        before.runs, _renamed(before, after), tuple(made.of(name) for name in names), noise_over(robot.file, names),
        robot.file.tunable, options,
    )  # fmt: skip
    compared = run_comparison(given, settings, np.random.default_rng(seed), progress)
    document = with_motors_changed(to_document(compared), robot)
    findings = dict.fromkeys((*before.findings, *_findings(before, after)))
    document["audit"] = [asdict(finding) for finding in findings]
    document["command"] = command or _command(robot, before, after, options, seed)
    document["runs"] = {"before": list(before.names), "after": list(after.names)}
    document["verdict_sentence"] = comparison_sentence(document)
    found = Comparison(document)
    if out is not None:
        progress("writing the report", 0.98)
        found.save(out)
    return found


def _distinct(before: Runs, after: Runs) -> None:
    """Raises BadInput where a run is in both sets, be it as a copy."""
    for run in after:
        twin = next((r for r in before if _equal(r, run)), None)
        if twin is not None:
            where = run.name if run.name == twin.name else f"{run.name} and {twin.name}"
            raise BadInput("the same run is in `before` and in `after`", where, "give two sets that share no run")


def _equal(a: Run, b: Run) -> bool:
    """Whether two runs hold the same samples."""
    if a.t.shape != b.t.shape or a.columns.keys() != b.columns.keys() or not np.array_equal(a.t, b.t):
        return False
    return all(np.array_equal(a.columns[k], b.columns[k], equal_nan=True) for k in a.columns)


def _long_enough(runs: Runs, option: str, horizon: float, unit: float) -> None:
    """Raises BadInput where a set is one run too short for two stretches, before minutes are spent on the other.

    unit: s, the shortest stretch."""
    stretch = max(unit, horizon)
    if len(runs) == 1 and np.ptp(runs[0].t) < 2.0 * stretch:
        raise BadInput(
            f"one run of {np.ptp(runs[0].t):.3g} s does not show how much the robot differs from itself; at least "
            f"2 stretches of {stretch:g} s are needed",
            f"{option}, {runs[0].name}",
            "add more or longer runs",
        )


def _renamed(before: Runs, after: Runs) -> tuple[Run, ...]:
    """The runs after, with names that none of those before has."""
    taken = set(before.names)
    return tuple(replace(r, name=f"after/{r.name}") if r.name in taken else r for r in after.runs)


def _findings(before: Runs, after: Runs) -> tuple[Finding, ...]:
    """Those of the runs after, which are called as `_renamed` does."""
    taken = set(before.names)
    return tuple(replace(f, run=f"after/{f.run}") if f.run in taken else f for f in after.findings)


def _command(robot: NominalRobot, before: Runs, after: Runs, options: Options, seed: int) -> str:
    words = ["residual-mpc", "compare", "--robot", robot.given, "--before", *before.paths, "--after", *after.paths]
    for option, values in (("--only", options.only), ("--without", options.without)):
        words += [word for value in values for word in (option, value)]
    return shlex.join([*words, "--horizon", f"{options.horizon:g}", "--seed", str(seed), "--out", "out"])
