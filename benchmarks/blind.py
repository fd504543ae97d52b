"""`make blind`: a development sweep into build/blind/: make, run, the proposed experiments, the baselines, score, page.

python -m benchmarks.blind [--out FOLDER] [--cases N] [--family F] [--level L] [--seed S] [--jobs J] [--no-baselines]
"""

from __future__ import annotations

import shlex
import sys
from pathlib import Path

import click

from residual_mpc.blind.experiment import ExperimentSettings, run_experiments
from residual_mpc.blind.families import family_names
from residual_mpc.blind.levels import LEVELS
from residual_mpc.blind.make import MakeSettings, make_suite
from residual_mpc.blind.run import RunSettings, run_suite
from residual_mpc.blind.score.page import text, write_page
from residual_mpc.blind.score.score import score_suite
from residual_mpc.blind.suite import write_json
from residual_mpc.cli.progress import progress_bar

BASELINES = ("single", "all_at_once", "sparse")


@click.command()
@click.option("--out", type=click.Path(path_type=Path, file_okay=False), default=Path("build/blind"), show_default=True)
@click.option("--cases", type=int, default=20, show_default=True, help="Number of cases per family and level.")
@click.option("--family", "families", multiple=True)
@click.option("--level", "levels", multiple=True)
@click.option("--seed", type=int, default=0, show_default=True)
@click.option("--jobs", type=int, default=-1, show_default=True)
@click.option("--baselines/--no-baselines", default=True)
def sweep(
    out: Path,
    cases: int,
    families: tuple[str, ...],
    levels: tuple[str, ...],
    seed: int,
    jobs: int,
    baselines: bool,
) -> None:
    """Make, diagnose and score a suite of development cases; a second call carries on."""
    settings = MakeSettings(families or family_names(), levels or tuple(LEVELS), cases, seed, jobs)
    with progress_bar() as progress:
        made = make_suite(settings, out / "suite", out / "answers", progress)
    click.echo(f"{len(made.suite.cases)} cases made, {len(made.failed)} could not be drawn", err=True)
    results = {"diagnose": out / "results"}
    with progress_bar() as progress:
        run_suite(out / "suite", results["diagnose"], RunSettings(jobs=jobs), progress)
    with progress_bar() as progress:
        run_experiments(
            out / "suite", out / "answers", results["diagnose"], out / "experiments", ExperimentSettings(jobs=jobs),
            progress,
        )  # fmt: skip
    for name in BASELINES if baselines else ():
        results[name.replace("_", " ")] = out / f"results-{name}"
        program = Path(sys.executable).with_name("residual-mpc")
        command = shlex.join([str(program), "blind", "baseline", name])
        with progress_bar() as progress:
            run_suite(out / "suite", out / f"results-{name}", RunSettings(command, jobs), progress)
    scores = score_suite(out / "suite", out / "answers", results, out / "openings.jsonl", out / "experiments")
    first, *others = (s.document() for s in scores.summaries)
    found = scores.experiments
    first["experiments"] = None if found is None else found.document()
    write_json(out / "score.json", {"score": {**first, "methods": others}})
    write_page(scores, out / "blind.html")
    for line in text(scores):
        click.echo(line)
    click.echo(f"page: {out / 'blind.html'}")


if __name__ == "__main__":
    sweep()
