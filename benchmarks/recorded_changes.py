"""Known changes in recorded runs: makes the sealed suites of all recordings, compares their halves, scores them.

python -m benchmarks.recorded_changes [--shared ../shared] [--source NAME ...] [--cases 20] [--seed 0]
                                      [--out build/recorded-changes] [--command PROGRAM] [--jobs 1] [--beside]

The recordings are no part of this repository. A source whose folder is absent says so, and the others are measured. A
call that was stopped goes on where it was. `--only-make` stops before the comparisons. `--beside` also diagnoses the
changed runs of each case and the same runs unchanged, and scores the difference.
"""

from __future__ import annotations

import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import click

from residual_mpc.blind.recorded.beside import difference, write_beside
from residual_mpc.blind.recorded.case_files import HALVES
from residual_mpc.errors import BadInput


@dataclass(frozen=True)
class Source:
    """Recorded runs of one robot, in a folder of the shared data."""

    name: str
    folder: str


SOURCES = (
    Source("xl330", "xl330"),
    Source("husky_drive", "husky_drive"),
    Source("husky_terrain", "husky_terrain"),
    Source("so101", "so101"),
    Source("pendulum_a", "pendulum/a"),
    Source("pendulum_c", "pendulum/c"),
)


@click.command()
@click.option("--shared", type=click.Path(path_type=Path, file_okay=False), default=Path("../shared"),
              show_default=True)  # fmt: skip
@click.option("--source", "names", multiple=True, type=click.Choice([s.name for s in SOURCES]), help="[default: all]")
@click.option("--cases", type=int, default=20, show_default=True, help="Cases of each source.")
@click.option("--seed", type=int, default=0, show_default=True, help="First seed; seeds from 100000 are test seeds.")
@click.option("--kind", "kinds", multiple=True, help="Kind of change; repeatable  [default: all]")
@click.option("--out", type=click.Path(path_type=Path, file_okay=False), default=Path("build/recorded-changes"),
              show_default=True)  # fmt: skip
@click.option("--command", default="", help="Another method: a program that takes the options of `compare`.")
@click.option("--jobs", type=int, default=1, show_default=True)
@click.option("--timeout", type=float, default=1800.0, show_default=True, help="s a case.")
@click.option("--only-make", is_flag=True)
@click.option("--beside", is_flag=True, help="Diagnose the changed runs beside the same runs untouched as well.")
def recorded_changes(
    shared: Path, names: tuple[str, ...], cases: int, seed: int, kinds: tuple[str, ...], out: Path, command: str,
    jobs: int, timeout: float, only_make: bool, beside: bool,
) -> None:  # fmt: skip
    """Make, run and score the suites of the recorded robots."""
    from residual_mpc.blind.recorded.score.page import lines, write_recorded_page
    from residual_mpc.blind.recorded.score.score import Swept, score_recorded
    from residual_mpc.blind.run import RunSettings, run_suite
    from residual_mpc.blind.suite import write_json
    from residual_mpc.cli.progress import progress_bar

    swept = []
    for source in (s for s in SOURCES if not names or s.name in names):
        folder = shared / "data" / source.folder
        if not (folder / "robot.toml").is_file():
            click.echo(f"{source.name}: {folder} is absent", err=True)
            continue
        place = out / source.name
        make(folder, place, cases, seed, kinds)
        if only_make:
            continue
        with progress_bar() as progress:
            run_suite(place / "suite", place / "results", RunSettings(command, jobs, timeout), progress)
        results = {"compare": place / "results"}
        if beside:
            results["diagnose"] = place / "beside"
            diagnose_beside(folder, place, cases, seed, kinds)
        swept.append(Swept(place / "suite", place / "answers", results, source.name))
    if not swept:
        return
    scores = score_recorded(swept, out / "openings.jsonl")
    write_json(out / "score.json", {"score": scores.summaries[0].document()})
    write_recorded_page(scores, out / "blind.html")
    for line in lines(scores):
        click.echo(line)
    click.echo(f"page: {out / 'blind.html'}")


def diagnose_beside(folder: Path, place: Path, cases: int, seed: int, kinds: tuple[str, ...]) -> None:
    """Write the difference of two diagnoses of each case to `beside`, unless it is there. The diagnoses see only the
    runs."""
    from residual_mpc.api.robot import load_robot
    from residual_mpc.api.runs import read_runs, usable
    from residual_mpc.blind.recorded.make import RecordedSettings, changed_halves
    from residual_mpc.blind.recorded.recipe import plan

    robot = load_robot(folder / "robot.toml")
    runs = usable(read_runs(robot, str(folder))).runs
    settings = RecordedSettings(cases, seed, kinds)
    for recipe in plan(robot.file.name, cases, seed, settings.test):
        result = place / "beside" / recipe.name
        if (result / "run.json").exists():
            continue
        _, untouched, changed, _ = changed_halves(robot.file, runs, settings, recipe)
        with tempfile.TemporaryDirectory() as work:
            write_beside(Path(work) / "case", robot.file, untouched, changed)
            _diagnose_both(Path(work) / "case", result)
        click.echo(f"{place.name}: {recipe.name} diagnosed", err=True)


def _diagnose_both(case: Path, result: Path) -> None:
    """Diagnose both halves and write the difference to `result`."""
    from residual_mpc import diagnose, load_robot, read_runs
    from residual_mpc.blind.suite import program_version, write_json

    begin, status, complaint = time.monotonic(), "done", ""
    result.mkdir(parents=True, exist_ok=True)
    try:
        robot = load_robot(case / "robot.toml")
        before, after = (diagnose(robot, read_runs(robot, case / half), seed=0).document for half in HALVES)
        write_json(result / "comparison.json", difference(before, after))
    except BadInput as error:
        status, complaint = "failed", str(error)
    write_json(
        result / "run.json",
        {"status": status, "exit_status": int(status != "done"), "seconds": time.monotonic() - begin,
         "complaint": complaint, "version": program_version(), "command": "diagnose"},
    )  # fmt: skip


def make(folder: Path, place: Path, cases: int, seed: int, kinds: tuple[str, ...]) -> None:
    """The suite of one source in ``place``; cases that are there stay."""
    from residual_mpc.api.robot import load_robot
    from residual_mpc.api.runs import read_runs, usable
    from residual_mpc.blind.recorded.make import RecordedSettings, make_recorded_suite

    robot = load_robot(folder / "robot.toml")
    runs = usable(read_runs(robot, str(folder))).runs
    settings = RecordedSettings(cases, seed, kinds)
    made = make_recorded_suite(robot.file, runs, settings, place / "suite", place / "answers")
    click.echo(f"{place.name}: {len(made.suite.cases)} cases of {len(runs)} runs", err=True)
    for name, why in made.failed:
        click.echo(f"{place.name}: {name} could not be made: {why}", err=True)


if __name__ == "__main__":
    recorded_changes()
