"""`residual-mpc excite`."""

from pathlib import Path
from typing import Any

import click

from residual_mpc.cli.common import (
    allow_user_modules,
    emit,
    json_option,
    robot_option,
    seed_option,
)
from residual_mpc.cli.progress import progress_bar
from residual_mpc.files import write_atomically


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
    import numpy as np

    from residual_mpc.diagnosis.document import read_diagnosis
    from residual_mpc.experiment.command_file import command_table
    from residual_mpc.experiment.plan import plan_first, plan_next
    from residual_mpc.models.load import load_robot
    from residual_mpc.models.robot_file import read_robot_file

    allow_user_modules()
    model = load_robot(read_robot_file(robot))
    rng = np.random.default_rng(seed)
    if diagnosis is None:
        plan = plan_first(model, limits, seconds, rng)
    else:
        document = read_diagnosis(diagnosis)
        with progress_bar() as progress:
            plan = plan_next(document, model, str(diagnosis), limits, seconds, rng, progress)
        if plan.purpose == "protocol":
            click.echo("nothing is confounded in this diagnosis: a protocol for further runs", err=True)
    for planned in plan.played:
        if not planned.within:
            click.echo(
                f"warning: {planned.motion.name}: a joint is predicted to leave its range, however small the motion; "
                "narrow it with --limit, or watch over it",
                err=True,
            )
    result = {**plan.document, "file": str(out)}
    write_atomically(out, command_table([p.motion for p in plan.played], plan.bench.actuators))
    if as_json:
        emit({"excite": result})
    else:
        _summary(result)


def _summary(result: dict[str, Any]) -> None:
    from residual_mpc.experiment.choose import PARTS

    if result["purpose"] == "explore":
        best, _, *elsewhere = result["motions"]
        click.echo("nothing in the library explains the gap: drive the motion that shows it most, twice")
        click.echo(
            f"  {best['name']}: the gap is expected to grow {best['shows']:.2g} times as fast as in the runs so far"
        )
        for m in elsewhere:
            click.echo(f"  then {m['name']}: goes where the runs hardly were ({', '.join(m['unseen'])})")
    elif not result["parts"]:
        click.echo(f"{len(result['motions'])} motions: {', '.join(m['name'] for m in result['motions'])}")
        hidden = sorted({n["effect"] for n in result["not_testable"]})
        if hidden:
            click.echo(f"  not even these would show: {', '.join(hidden)}")
    else:
        click.echo(f"to tell apart: {', '.join(result['parts'])}")
        if result["sensors"]:
            click.echo(f"  log besides: {', '.join(result['sensors'])}; no motion alone will do")
        if result["switches"]:
            click.echo("  switch the motors off at times (enabled.*); no motion alone will do")
        click.echo(f"  drive: {', then '.join(result['played'])}")
        for m in result["motions"]:
            click.echo(f"    {m['name']}: the wrong one is expected to lose by a likelihood ratio of {m['ratio']:.3g}")
        if not result["told_apart"]:
            click.echo(f"  none is expected to part them beyond doubt ({PARTS:g}): another sensor or a known load may")
    click.echo(f"  commands: {result['file']}")
