"""`residual-mpc excite`."""

from pathlib import Path

import click

from residual_mpc.cli.common import emit, json_option, robot_option, seed_option
from residual_mpc.cli.progress import progress_bar


def _limits(context: click.Context, option: click.Parameter, given: tuple[str, ...]) -> dict[str, tuple[float, float]]:
    out = {}
    for text in given:
        name, _, bounds = text.partition("=")
        low, _, high = bounds.partition(":")
        try:
            out[name] = (float(low), float(high))
        except ValueError:
            raise click.BadParameter(f"{text!r} is not ACTUATOR=LOW:HIGH.", context, option) from None
        if not out[name][0] < out[name][1]:
            raise click.BadParameter(f"{text!r}: the lower end comes first.", context, option)
    return out


@click.command()
@click.argument("diagnosis", required=False, type=click.Path(path_type=Path))
@robot_option
@click.option("--out", type=click.Path(path_type=Path, dir_okay=False), required=True, help="CSV file of the commands.")
@click.option("--seconds", type=click.FloatRange(4.0, 120.0), default=20.0, show_default=True, help="Of a motion.")
@click.option(
    "--limit", "limits", multiple=True, callback=_limits, metavar="ACTUATOR=LOW:HIGH",
    help="How far an actuator may be driven; by default as far as in the runs that were diagnosed, else what the model "
    "states. May be repeated.",
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
    """Plan the next runs. With a DIAGNOSIS whose causes the runs could not tell apart: the motion that parts them best,
    tried in simulation. With one whose gap nothing explains: the motion that shows it most, twice, and the one that
    goes where no run has been. Without one: a first protocol for a robot that has no runs yet.

    The commands stay within the limits, and the model's joints within theirs (where no smaller motion will do, a
    warning says so); nothing here knows of tables and walls.
    """
    from residual_mpc.api.excitation import excite as plan_motions
    from residual_mpc.api.robot import load_robot

    nominal = load_robot(robot)
    with progress_bar() as progress:
        plan = plan_motions(nominal, diagnosis, seconds=seconds, limits=limits, seed=seed, progress=progress)
    if diagnosis is not None and plan.document["purpose"] == "protocol":
        click.echo("nothing is confounded in this diagnosis: a protocol for further runs", err=True)
    for warning in plan.warnings:
        click.echo(f"warning: {warning}", err=True)
    plan.save(out)
    if as_json:
        emit({"excite": {**plan.document, "file": str(out)}})
        return
    for line in (*plan.lines(), f"  commands: {out}"):
        click.echo(line)
