"""What the commands share: options, loading, audit, printing."""

import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from residual_mpc.errors import BadInput

if TYPE_CHECKING:
    from residual_mpc.logs.finding import Finding
    from residual_mpc.logs.run import Run
    from residual_mpc.models.protocol import Robot
    from residual_mpc.models.robot_file import RobotFile

Command = Callable[..., Any]

robot_option = click.option(
    "--robot", "robot", required=True, metavar="R", help="Robot file, or a built-in robot's name."
)
runs_argument = click.argument("runs", nargs=-1, required=True, metavar="RUN...")
json_option = click.option(
    "--json", "as_json", is_flag=True, help="Print the result as JSON on stdout, and nothing else there."
)
seed_option = click.option(
    "--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Seed of everything random."
)


def out_option(holds: str) -> Callable[[Command], Command]:
    """--out, the folder for the files that it `holds`."""
    kind = click.Path(path_type=Path, file_okay=False)
    return click.option("--out", type=kind, required=True, help=f"Folder for {holds}.")


def _a_number(context: click.Context, option: click.Parameter, value: float) -> float:
    if value != value:  # NaN, which no range excludes
        raise click.BadParameter("nan is no length of a window.", context, option)
    return value


horizon_option = click.option(
    "--horizon",
    type=click.FloatRange(min=0.05, max=60.0),
    callback=_a_number,
    default=1.0,
    show_default=True,
    help="Length of a window, s.",
)


@dataclass(frozen=True)
class Loaded:
    """A call's input, read and audited. robots[i] is the nominal model of runs[i]; noise: 1-sigma of each channel that
    the robot file states one of."""

    robot_file: "RobotFile"
    runs: "tuple[Run, ...]"
    robots: "tuple[Robot, ...]"
    findings: "tuple[Finding, ...]"
    noise: dict[str, float]


def load(robot: str, paths: Sequence[str], quiet: bool = False) -> Loaded:
    """Read the robot file and the runs, build the models, audit. Raises BadInput for anything that cannot be used."""
    from residual_mpc.logs.audit import audit
    from residual_mpc.logs.read import read_runs
    from residual_mpc.models.facts import check_columns, facts_of
    from residual_mpc.models.load import load_robot
    from residual_mpc.models.robot_file import for_run, noise_over, read_robot_file

    allow_user_modules()
    robot_file = read_robot_file(robot)
    first = load_robot(robot_file)  # a faulty model is reported before a long read
    result = read_runs(paths, robot_file)
    built: dict[object, Robot] = {}
    robots = []
    for run in result.runs:
        mine = for_run(robot_file, run.name)
        key = repr(replace(mine, noise={}, log={}, variants=()))  # all that makes the model
        if key not in built:
            built[key] = load_robot(mine)
        robots.append(built[key])
    check_columns(result.runs, robots)
    findings = (*result.findings, *audit(result.runs, facts_of(first)))
    fatal = [f for f in findings if f.severity == "error"]
    if fatal:
        worst = fatal[0]
        where = ", ".join(str(x) for x in (worst.run, worst.column) if x)
        raise BadInput(worst.message, where, worst.remedy)
    if not quiet:
        show_findings(findings)
    noise = noise_over(robot_file, [run.name for run in result.runs])
    return Loaded(robot_file, result.runs, tuple(robots), findings, noise)


def show_findings(findings: "Sequence[Finding]") -> None:
    """Warnings on stderr; what is merely noted is counted."""
    for f in findings:
        if f.severity != "info":
            where = ", ".join(str(x) for x in (f.run, f.column) if x)
            click.echo(f"{f.severity}: {where}: {f.message}. {f.remedy}".replace("..", "."), err=True)
    noted = sum(f.severity == "info" for f in findings)
    if noted:
        click.echo(f"note: {noted} more remark{'s' if noted > 1 else ''}; `residual-mpc check` lists them", err=True)


def emit(document: dict[str, Any]) -> None:
    """One JSON document on stdout."""
    click.echo(json.dumps(document, indent=2, allow_nan=False))


def name_robot_file(model: dict[str, Any], robot_file: "RobotFile", out: Path) -> None:
    """Write into a model's document where its robot file lies, seen from `out`, so that `export` finds it again.

    A robot that was given by its built-in name has no file; its name is enough.
    """
    import os

    if robot_file.source:
        model["robot_file"] = os.path.relpath(robot_file.source, out)


def writable_folder(folder: Path) -> None:
    """Raises BadInput for a folder that could not be written, before minutes are spent on what goes into it."""
    import os

    there = next(p for p in (folder, *folder.absolute().parents) if os.path.exists(p))
    if not there.is_dir():
        came = "is a file" if there == folder else f"{there} is a file"
        raise BadInput(came, str(folder), "name a folder with --out")
    if not os.access(there, os.W_OK | os.X_OK):
        raise BadInput(f"{there} may not be written", str(folder), "choose another folder with --out")


def allow_user_modules() -> None:
    """A user's plant `package.module:factory` may live in the folder they stand in."""
    if "" not in sys.path and str(Path.cwd()) not in sys.path:
        sys.path.insert(0, str(Path.cwd()))
