"""`residual-mpc excite`."""

from pathlib import Path

import click

from residual_mpc.cli.common import emit, json_option, robot_option, seed_option
from residual_mpc.cli.options import with_options
from residual_mpc.cli.progress import progress_bar


def _limits(context: click.Context, option: click.Parameter, given: tuple[str, ...]) -> dict[str, tuple[float, float]]:
    out = {}
    for text in given:
        name, _, bounds = text.partition("=")
        low, _, high = bounds.partition(":")
        try:
            out[name] = (float(low), float(high))
        except ValueError:
            raise click.BadParameter(f"must be ACTUATOR=LOW:HIGH, got {text!r}.", context, option) from None
        if not out[name][0] < out[name][1]:
            raise click.BadParameter(f"the lower limit must be below the upper limit, got {text!r}.", context, option)
    return out


@click.command()
@click.argument("diagnosis", required=False, type=click.Path(path_type=Path))
@robot_option
@click.option("--out", type=click.Path(path_type=Path, dir_okay=False), required=True, help="CSV file of the commands.")
@click.option(
    "--seconds",
    type=click.FloatRange(4.0, 120.0),
    default=20.0,
    show_default=True,
    help="Duration of each motion in seconds.",
)
@click.option(
    "--limit", "limits", multiple=True, callback=_limits, metavar="ACTUATOR=LOW:HIGH",
    help="Command range of an actuator; repeatable. Defaults to the range in the diagnosed runs, or to the model's "
    "limits without a diagnosis.",
)  # fmt: skip
@json_option
@seed_option
def excite(
    diagnosis: Path | None,
    robot: str,
    out: Path,
    seconds: float,
    limits: dict[str, tuple[float, float]],
    as_json: bool,
    seed: int,
) -> None:
    """Plan the next runs.

    If the DIAGNOSIS left several causes indistinguishable, plans the motion that separates them best in simulation. If
    it left the gap unexplained, plans the motion that shows the gap most, twice, and the motion that covers states
    no run has visited. Without a DIAGNOSIS, plans a first set of motions for a robot that has no runs yet.

    The commands stay within the limits, and the model's joints within their ranges; a warning names any motion for
    which this is impossible. Obstacles around the robot are not considered.
    """
    from residual_mpc.api.excitation import excite as plan_motions
    from residual_mpc.api.robot import load_robot

    nominal = load_robot(robot)
    with progress_bar() as progress:
        plan = plan_motions(nominal, diagnosis, seconds=seconds, limits=limits, seed=seed, out=out, progress=progress)
    if diagnosis is not None and plan.document["purpose"] == "protocol":
        click.echo("this diagnosis left nothing to tell apart: planning a general set of motions", err=True)
    for warning in plan.warnings:
        click.echo(f"warning: {with_options(warning)}", err=True)
    plan.save(out)
    if as_json:
        emit({"excite": {**plan.document, "file": str(out)}})
        return
    for line in (*plan.lines(), f"  commands: {out}"):
        click.echo(line)
