"""`residual-mpc run`."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from residual_mpc.cli.common import ROBOT, emit, json_option, seed_option, writable_folder
from residual_mpc.cli.progress import progress_bar
from residual_mpc.errors import BadInput

if TYPE_CHECKING:
    from residual_mpc.closed_loop.scenario import RunOptions


@click.command()
@click.argument("scenario", required=False)
@click.option(
    "--controller", type=click.Choice(["mpc", "lqr"]), default="mpc", show_default=True, help="Controller type."
)
@click.option("--seeds", type=click.IntRange(1, 1000), default=10, show_default=True, help="Number of plants to draw.")
@click.option("--robot", "robot", metavar="R", help=f"Your own robot in place of a scenario: {ROBOT}.")
@click.option(
    "--model", type=click.Path(path_type=Path), help="Its model: diagnosis.json or model.json. Needs --robot."
)
@click.option(
    "--reference", metavar="CSV|NAME",
    help="Reference: a CSV with t and position.* (or tool.x, tool.y, tool.z; for a robot that drives pose.*), or one "
    "of an arm's motions sines (default), postures and circle.",
)  # fmt: skip
@click.option(
    "--plant", metavar="MODULE:FACTORY",
    help="Plant: factory(robot_file, period) -> simulator; by default the robot in MuJoCo at a quarter of its step.",
)  # fmt: skip
@click.option(
    "--withheld", type=click.Path(path_type=Path),
    help="model.json with the effects of the MuJoCo plant; by default those of --model. Not with --plant.",
)  # fmt: skip
@click.option("--dt", type=click.FloatRange(1e-3, 0.5), help="Sample time of your own robot's controllers in seconds.")
@click.option(
    "--budget", type=click.FloatRange(min=0.0, min_open=True), metavar="S",
    help="Time limit of the MPC per sample in seconds, after which it applies its current plan; results then depend on "
    "the machine. Without a limit, late samples are only counted.",
)  # fmt: skip
@click.option(
    "--out", type=click.Path(path_type=Path), help="Folder for the episodes (as runs), the diagnosis and the figure."
)
@json_option
@seed_option
def run(
    scenario: str | None, controller: str, robot: str | None, model: Path | None, reference: str | None,
    plant: str | None, withheld: Path | None, dt: float | None, seeds: int, budget: float | None, out: Path | None,
    as_json: bool, seed: int,
) -> None:
    """Run a closed-loop SCENARIO that compares the nominal and the augmented controllers; without a name, list them.

    The nominal controller first records a log, the log is diagnosed, and then every controller drives every seed. With
    ten seeds this takes some minutes. With --robot and --model your own robot follows a reference instead.
    """
    from residual_mpc.closed_loop.scenario import RunOptions, find_scenario, scenario_names

    options = RunOptions("lqr" if controller == "lqr" else "mpc", seeds, seed, out, budget or math.inf)
    if robot is not None or model is not None:
        _refuse_mixed(scenario, robot, model)
        assert robot is not None and model is not None
        if out is not None:
            writable_folder(out)
        result = _own(robot, model, reference or "sines", plant, withheld, dt, options)
        if as_json:
            emit(result)
        else:
            _show(f"{robot}: {result['scenario']}", result)
        return
    for option, given in (("--reference", reference), ("--plant", plant), ("--withheld", withheld), ("--dt", dt)):
        if given is not None:
            raise BadInput(f"{option} is for a robot of your own", option, "give --robot R and --model FILE as well")
    if scenario is None:
        summaries = {name: find_scenario(name).summary for name in scenario_names()}
        if as_json:
            emit({"scenarios": [{"name": n, "summary": s} for n, s in summaries.items()]})
            return
        width = max((len(n) for n in summaries), default=0)
        for name, summary in summaries.items():
            click.echo(f"{name:<{width}}  {summary}")
        return
    found = find_scenario(scenario)
    if out is not None:
        writable_folder(out)
    with progress_bar() as progress:
        result = found.run(options, progress)
    if as_json:
        emit(result)
        return
    _show(f"{found.name}: {found.summary}", result)


def _refuse_mixed(scenario: str | None, robot: str | None, model: Path | None) -> None:
    if scenario is not None:
        raise BadInput(
            f"the scenario {scenario!r} cannot be combined with --robot and --model", scenario, "leave one of them out"
        )
    if robot is None or model is None:
        missing = "--robot" if robot is None else "--model"
        raise BadInput(f"{missing} is missing", "", "your own robot needs --robot R and --model FILE")


def _own(
    robot: str, model: Path, reference: str, plant: str | None, withheld: Path | None, dt: float | None,
    options: "RunOptions",
) -> dict[str, Any]:  # fmt: skip
    from residual_mpc.api.model import augment
    from residual_mpc.api.robot import load_robot
    from residual_mpc.closed_loop.scenario import find_own_scenario
    from residual_mpc.learning.network.written import residual_in
    from residual_mpc.models.load import load_factory
    from residual_mpc.models.model_file import read_written

    nominal = load_robot(robot)
    learned = model if residual_in(read_written(model)) is not None else None
    augmented = augment(nominal, model, learned, dt=dt)
    factory = None if plant is None else load_factory(plant, "--plant", nominal.file.folder)
    with progress_bar() as progress:
        return find_own_scenario()(nominal, augmented, reference, factory, withheld, options, progress)


def _show(title: str, result: dict[str, Any]) -> None:
    """Print the results of a run, one line per controller."""
    unit = f"m{result.get('unit', 'm')}"
    click.echo(title)
    for name, c in result.get("controllers", {}).items():
        h2 = c["h2_norm"].values() if isinstance(c["h2_norm"], dict) else [c["h2_norm"]]
        norm = " -> ".join("diverged" if v is None else f"{v:.3f}" for v in h2)
        share = (result["recovered"].get(name) or {}).get("value")
        got = "" if share is None else f"   recovered {round(share, 2) + 0.0:.0%}"
        late = f", {c['late']} late" if c.get("late") else ""
        off = "diverged" if c["tracking_rmse"] is None else f"{1e3 * c['tracking_rmse']:6.2f} {unit}"
        click.echo(
            f"  {name:<10} tracking {off}   H2 {norm}   "
            f"{c['solve_ms']['median']:.2f} ms a step, {c['failures']} failures{late}{got}"
        )
    for note in result.get("notes", ()):
        click.echo(f"  note: {note}")
    if "h2_norm" in result:
        click.echo(f"  H2 norm {result['h2_norm']['first']:.3f} -> {result['h2_norm']['last']:.3f}")
