"""`residual-mpc compare`."""

import shlex
import sys
from pathlib import Path

import click

from residual_mpc.cli.common import (
    emit,
    horizon_option,
    json_option,
    names,
    out_option,
    read,
    robot_option,
    seed_option,
    show_findings,
    writable_folder,
)
from residual_mpc.cli.many import TakingMany
from residual_mpc.cli.progress import progress_bar


@click.command(cls=TakingMany)
@robot_option
@click.option("--before", multiple=True, required=True, metavar="RUN...", help="Runs before the change.")
@click.option("--after", multiple=True, required=True, metavar="RUN...", help="Runs after the change.")
@out_option("comparison.json and report.html")
@click.option(
    "--only", multiple=True, metavar="EFFECT", help="Consider only these effects; comma-separated, repeatable."
)
@click.option("--without", multiple=True, metavar="EFFECT", help="Exclude these effects; comma-separated, repeatable.")
@horizon_option
@json_option
@seed_option
def compare(
    robot: str,
    before: tuple[str, ...],
    after: tuple[str, ...],
    out: Path,
    only: tuple[str, ...],
    without: tuple[str, ...],
    horizon: float,
    as_json: bool,
    seed: int,
) -> None:
    """Find what changed between two sets of runs of one robot, by how much, and what these runs cannot show."""
    writable_folder(out)
    nominal, earlier = read(robot, before, quiet=True)
    _, later = read(robot, after, quiet=True)
    show_findings((*earlier.findings, *later.findings))

    from residual_mpc.api.comparison import compare as run_comparison

    with progress_bar() as progress:
        found = run_comparison(
            nominal, earlier, later, only=names(only), without=names(without), horizon=horizon, seed=seed, out=out,
            command=shlex.join(["residual-mpc", *sys.argv[1:]]), progress=progress,
        )  # fmt: skip
    if as_json:
        emit({"compare": found.document})
        return
    for line in found.lines():
        click.echo(line)
    click.echo(f"  report: {out / 'report.html'}")
