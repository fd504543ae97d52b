"""What the commands share: options, loading, audit, printing."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from residual_mpc.errors import BadInput

if TYPE_CHECKING:
    from residual_mpc.api.robot import NominalRobot
    from residual_mpc.api.runs import Runs
    from residual_mpc.logs.finding import Finding

Command = Callable[..., Any]

ROBOT = "Robot file, MJCF file, or a built-in robot's name (a URDF has no actuators: name it in a robot file)"
robot_option = click.option("--robot", "robot", required=True, metavar="R", help=f"{ROBOT}.")
runs_argument = click.argument("runs", nargs=-1, required=True, metavar="RUN...")
json_option = click.option(
    "--json", "as_json", is_flag=True, help="Print the result as JSON on stdout and nothing else there."
)
seed_option = click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Random seed.")


def out_option(holds: str) -> Callable[[Command], Command]:
    """--out, the folder for the files that it `holds`."""
    kind = click.Path(path_type=Path, file_okay=False)
    return click.option("--out", type=kind, required=True, help=f"Folder for {holds}.")


def a_number(context: click.Context, option: click.Parameter, value: float | None) -> float | None:
    """The value. Raises BadParameter for NaN."""
    if value != value:  # NaN, which no range excludes
        raise click.BadParameter("must be a number, got nan.", context, option)
    return value


horizon_option = click.option(
    "--horizon",
    type=click.FloatRange(min=0.05, max=60.0),
    callback=a_number,
    default=1.0,
    show_default=True,
    help="Prediction horizon in seconds.",
)


def read(robot: str, paths: Sequence[str], quiet: bool = False) -> "tuple[NominalRobot, Runs]":
    """The robot and its audited runs, with what the audit warns of on stderr. Raises BadInput for anything that cannot
    be used."""
    from residual_mpc.api.robot import load_robot
    from residual_mpc.api.runs import read_runs, usable

    nominal = load_robot(robot)  # a faulty model is reported before a long read
    runs = usable(read_runs(nominal, paths))
    if not quiet:
        show_findings(runs.findings)
    return nominal, runs


def names(given: Sequence[str]) -> tuple[str, ...]:
    """Comma-separated or repeated."""
    return tuple(n.strip() for g in given for n in g.split(",") if n.strip())


def show_findings(findings: "Sequence[Finding]") -> None:
    """Warnings on stderr, each once; what is merely noted is counted."""
    told = [f"{f.severity}: {BadInput(f.message, f.where, f.remedy)}" for f in findings if f.severity != "info"]
    for line in dict.fromkeys(told):
        click.echo(line, err=True)
    noted = len({(f.message, f.where, f.remedy) for f in findings if f.severity == "info"})
    if noted:
        click.echo(
            f"note: {noted} further remark{'s' if noted > 1 else ''}; run `residual-mpc check` to list "
            f"{'them' if noted > 1 else 'it'}",
            err=True,
        )


def emit(document: dict[str, Any]) -> None:
    """One JSON document on stdout."""
    click.echo(json.dumps(document, indent=2, allow_nan=False))


def writable_folder(folder: Path) -> None:
    """Raises BadInput for a folder that could not be written, before minutes are spent on what goes into it."""
    import os

    there = next(p for p in (folder, *folder.absolute().parents) if os.path.exists(p))
    if not there.is_dir():
        came = "must be a folder, got a file" if there == folder else f"{there} must be a folder, got a file"
        raise BadInput(came, str(folder), "name a folder with --out")
    if not os.access(there, os.W_OK | os.X_OK):
        raise BadInput(f"no permission to write to {there}", str(folder), "choose another folder with --out")
