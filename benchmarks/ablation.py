"""What each means of the diagnosis does for each level: the blind benchmark on development seeds without it.

python -m benchmarks.ablation [--cases N] [--seed S] [--without NAME ...] [--out FOLDER] [--jobs J]

The suite is made once; a second call carries on, and adds what was not asked for before. Prints a table in Markdown.
"""

import os
import shlex
import sys
from pathlib import Path

import click

from benchmarks.without import MEANS

ROOT = Path(__file__).resolve().parents[1]


@click.command()
@click.option("--cases", type=int, default=8, show_default=True, help="Wheeled robots at each level.")
@click.option("--seed", type=int, default=8000, show_default=True)
@click.option("--without", "lacking", multiple=True, type=click.Choice(list(MEANS)), help="[default: each]")
@click.option("--out", type=click.Path(path_type=Path, file_okay=False), default=Path("build/ablation"),
              show_default=True)  # fmt: skip
@click.option("--jobs", type=int, default=-1, show_default=True)
def ablation(cases: int, seed: int, lacking: tuple[str, ...], out: Path, jobs: int) -> None:
    """Diagnose the same cases whole and without each means."""
    from residual_mpc.blind.levels import LEVELS
    from residual_mpc.blind.make import MakeSettings, make_suite
    from residual_mpc.blind.run import RunSettings, run_suite
    from residual_mpc.blind.score.score import score_suite
    from residual_mpc.cli.progress import progress_bar

    os.environ["PYTHONPATH"] = str(ROOT)  # the cases are diagnosed in folders of their own
    drawn = MakeSettings(("wheeled",), tuple(LEVELS), cases, seed, jobs)
    with progress_bar() as progress:
        make_suite(drawn, out / "suite", out / "answers", progress)
    results = {}
    for name in ("", *(lacking or MEANS)):
        command = shlex.join([sys.executable, "-m", "benchmarks.without", name]) if name else ""
        results[name or "whole"] = out / (name or "whole")
        with progress_bar() as progress:
            run_suite(out / "suite", out / (name or "whole"), RunSettings(command, jobs), progress)
    scores = score_suite(out / "suite", out / "answers", results, out / "openings.jsonl")
    levels = list(scores.summaries[0].by_level)
    click.echo(f"| without | {' | '.join(levels)} | all | s a case |")
    click.echo("| --- " * (len(levels) + 3) + "|")
    for summary in scores.summaries:
        rates = [*summary.by_level.values(), summary.right]
        cells = " | ".join(f"{r.hits} of {r.count}" for r in rates)
        seconds = f"{summary.seconds:.1f}" if summary.seconds else ""
        click.echo(f"| {summary.method.replace('_', ' ')} | {cells} | {seconds} |")


if __name__ == "__main__":
    ablation()
