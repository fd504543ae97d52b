"""`residual-mpc excite`."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from residual_mpc.cli.common import (
    allow_user_modules,
    emit,
    json_option,
    progress_bar,
    robot_option,
    seed_option,
    write_atomically,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from residual_mpc.experiment.bench import Bench
    from residual_mpc.experiment.explanations import Explanation
    from residual_mpc.experiment.motions import Motion
    from residual_mpc.experiment.separate import Planned


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
    tried in simulation. Without one: a first protocol for a robot that has no runs yet.

    The commands stay within the limits, and the model's joints within theirs (where no smaller motion will do, a
    warning says so); nothing here knows of tables and walls.
    """
    import numpy as np

    from residual_mpc.diagnosis.document import read_diagnosis
    from residual_mpc.experiment.bench import bench_of, bench_of_model
    from residual_mpc.experiment.choose import choose, protocol
    from residual_mpc.experiment.explanations import explanations_of
    from residual_mpc.models.load import load_robot
    from residual_mpc.models.robot_file import read_robot_file

    allow_user_modules()
    model = load_robot(read_robot_file(robot))
    rng = np.random.default_rng(seed)
    explanations: tuple[Explanation, ...] = ()
    if diagnosis is None:
        bench = bench_of_model(model, limits)
    else:
        document = read_diagnosis(diagnosis)
        bench = bench_of(document, model, str(diagnosis), limits)
        explanations = explanations_of(document, model, str(diagnosis))
    result: dict[str, Any]
    if len(explanations) < 2:
        if diagnosis is not None:
            click.echo("nothing is confounded in this diagnosis: a protocol for further runs", err=True)
        played, hidden = protocol(model, bench, seconds, rng)
        result = {
            "parts": [], "motions": [_described(p, None) for p in played], "told_apart": None, "sensors": [],
            "not_testable": [{"effect": n.term.effect, "target": n.term.target} for n in hidden],
        }  # fmt: skip
    else:
        with progress_bar() as progress:
            found = choose(model, bench, [e.values for e in explanations], seconds, rng, progress)
        result = {
            "parts": [e.name for e in explanations],
            "motions": [_described(s.planned, s.ratio) for s in found.motions],
            "told_apart": found.parts, "sensors": list(found.sensors), "not_testable": [],
        }  # fmt: skip
        played = (found.best.planned,)
    for planned in played:
        if not planned.within:
            click.echo(
                f"warning: {planned.motion.name}: a joint is predicted to leave its range, however small the motion; "
                "narrow it with --limit, or watch over it",
                err=True,
            )
    result["file"] = str(out)
    write_atomically(out, _table([p.motion for p in played], bench))
    if as_json:
        emit({"excite": result})
    else:
        _summary(result)


def _described(planned: "Planned", ratio: float | None) -> dict[str, Any]:
    return {"name": planned.motion.name, "ratio": ratio, "within_limits": planned.within}


def _table(motions: "Sequence[Motion]", bench: "Bench") -> str:
    """CSV by the log format: one run a motion."""
    many = len(motions) > 1
    switched = any(m.enabled is not None for m in motions)
    header = [*(["run"] if many else []), "t", *(f"command.{a}" for a in bench.actuators)]
    header += [f"enabled.{a}" for a in bench.actuators] if switched else []
    lines = [",".join(header)]
    for m in motions:
        for k, t in enumerate(m.t):
            on = [] if not switched else [1] * len(bench.actuators) if m.enabled is None else m.enabled[k].astype(int)
            cells = [f"{t:.6g}", *(f"{u:.6g}" for u in m.command[k]), *(str(x) for x in on)]
            lines.append(",".join([*([m.name.replace(",", "").replace(" ", "_")] if many else []), *cells]))
    return "\n".join(lines) + "\n"


def _summary(result: dict[str, Any]) -> None:
    from residual_mpc.experiment.choose import PARTS

    if not result["parts"]:
        click.echo(f"{len(result['motions'])} motions: {', '.join(m['name'] for m in result['motions'])}")
        hidden = sorted({n["effect"] for n in result["not_testable"]})
        if hidden:
            click.echo(f"  not even these would show: {', '.join(hidden)}")
    else:
        best = result["motions"][0]
        click.echo(f"to tell apart: {', '.join(result['parts'])}")
        if result["sensors"]:
            click.echo(f"  log besides: {', '.join(result['sensors'])}; no motion alone will do")
        click.echo(f"  drive: {best['name']}")
        for m in result["motions"]:
            click.echo(f"    {m['name']}: the wrong one is expected to lose by a likelihood ratio of {m['ratio']:.3g}")
        if not result["told_apart"]:
            click.echo(f"  none is expected to part them beyond doubt ({PARTS:g}): another sensor or a known load may")
    click.echo(f"  commands: {result['file']}")
