"""`residual-mpc batch`."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from residual_mpc.cli.common import ROBOT, emit, json_option, out_option, seed_option, writable_folder
from residual_mpc.cli.progress import progress_bar

if TYPE_CHECKING:
    from residual_mpc.batch.run import Outcome

PAGE = "index.html"


@click.command()
@click.argument("folders", nargs=-1, required=True, metavar="FOLDER...", type=click.Path(path_type=Path))
@click.option("--robot", metavar="R", help=f"{ROBOT}, of the folders without a robot.toml.")
@out_option("a folder of results for each FOLDER, and index.html")
@click.option("--options", default="", metavar="TEXT", help='Options for every diagnosis, such as "--without payload".')
@click.option("--jobs", type=int, default=-1, show_default=True, help="Diagnoses at once; -1 for all cores.")
@click.option("--timeout", type=float, default=3600.0, show_default=True, help="Time limit for each, seconds.")
@click.option("--engine", default="processes", show_default=True, help="processes, or dask for several machines.")
@click.option("--address", default="", help="Address of a running Dask scheduler  [default: a local cluster]")
@json_option
@seed_option
def batch(
    folders: tuple[Path, ...],
    robot: str | None,
    out: Path,
    options: str,
    jobs: int,
    timeout: float,
    engine: str,
    address: str,
    as_json: bool,
    seed: int,
) -> None:
    """Diagnose many robots: each FOLDER holds the runs of one, and its robot.toml if it has a model of its own.

    The results are in the folders of the same names below --out, and index.html compares them. Run the same command
    again to resume; only robots whose runs, model or options have changed are diagnosed again. With dask, the workers
    have to see the same files. The exit status is 2 if any diagnosis fails; the others stand.
    """
    writable_folder(out)
    from residual_mpc.batch.jobs import jobs_in
    from residual_mpc.batch.run import BatchSettings, run_batch
    from residual_mpc.files import write_atomically
    from residual_mpc.processes.engine import Engine
    from residual_mpc.report.index import entries_in, index_page

    settings = BatchSettings(options, seed, timeout, Engine(engine, jobs, address))
    todo = jobs_in(folders, robot, out)
    with progress_bar() as progress:
        outcomes = run_batch(todo, out, settings, progress)
    write_atomically(out / PAGE, index_page(out.resolve().name, entries_in(out)))
    if as_json:
        emit({"batch": {"results": [o.document() for o in outcomes], "index": str(out / PAGE)}})
    else:
        _show(outcomes)
        click.echo(f"  index: {out / PAGE}")
    if not all(o.done for o in outcomes):
        sys.exit(2)


def _show(outcomes: "list[Outcome]") -> None:
    """A line for each robot, the largest remaining gap first; what failed last."""
    from residual_mpc.report.words.numbers import number

    width = max(len(o.name) for o in outcomes)
    for o in sorted((o for o in outcomes if o.done), key=lambda o: -(o.after or 0.0)):
        assert o.before is not None and o.after is not None and o.floor is not None
        gap = f"{number(o.before)} -> {number(o.after)} (noise floor {number(o.floor)})"
        click.echo(f"{o.name:<{width}}  {o.verdict:<8}  {gap}  {', '.join(o.effects)}".rstrip())
    for o in (o for o in outcomes if not o.done):
        click.echo(f"{o.name:<{width}}  {o.status}: {o.complaint}".rstrip(": "), err=True)
