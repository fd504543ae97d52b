"""`residual-mpc learn`."""

import json
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Any

import click

from residual_mpc.cli.common import (
    emit,
    json_option,
    load,
    name_robot_file,
    out_option,
    robot_option,
    runs_argument,
    seed_option,
    writable_folder,
)
from residual_mpc.errors import BadInput
from residual_mpc.files import write_atomically

if TYPE_CHECKING:
    from residual_mpc.residual.train import Learned, Task

NOTE = (
    "A network without memory cannot learn what depends on more than the present motion and command: dead time, play, "
    "slow drift and sensor effects. A diagnosis names these: learn on top of it with --on."
)


@click.command()
@robot_option
@runs_argument
@out_option("model.json, learn.json and the checkpoint")
@click.option(
    "--case",
    type=click.Choice(["sim-to-dyn", "real-to-dyn", "real-to-sim"]),
    default="real-to-dyn",
    show_default=True,
    help="Which model learns from which: the runs are the simulator's or the robot's, R the dynamic model or the "
    "simulator.",
)
@click.option("--on", type=click.Path(path_type=Path), help="Learn on top of this diagnosis.json (or model.json).")
@click.option(
    "--warm-start", type=click.Path(path_type=Path), help="The model.json of the case before, to build its residual on."
)
@click.option(
    "--form", type=click.Choice(["body", "paper", "joint"]), help="Which velocities are corrected, from what."
)
@click.option("--hidden", default="10,10", show_default=True, help="Nodes of the hidden layers.")
@click.option("--method", type=click.Choice(["auto", "ukf", "ekf"]), default="auto", show_default=True)
@click.option("--passes", type=click.IntRange(1, 100), default=5, show_default=True, help="Times through the data.")
@click.option("--step", type=click.FloatRange(0.001, 1.0), help="Step of the residual, s.")
@click.option(
    "--weights", metavar="CHANNEL=C,...", help="The paper's costs: how much a channel's errors count, as pose.theta=2."
)
@json_option
@seed_option
def learn(
    robot: str,
    runs: tuple[str, ...],
    out: Path,
    case: str,
    on: Path | None,
    warm_start: Path | None,
    form: str | None,
    hidden: str,
    method: str,
    passes: int,
    step: float | None,
    weights: str | None,
    as_json: bool,
    seed: int,
) -> None:
    """Train the residual network of a robot on runs with a Kalman filter, and measure it on runs kept back.

    Killed at any moment and called again, it goes on from its last checkpoint to the same weights.
    """
    writable_folder(out)
    layers, costs = _layers(hidden), _costs(weights)
    loaded = load(robot, runs)

    import numpy as np

    from residual_mpc.residual import checkpoint
    from residual_mpc.residual.learn import LearnSettings
    from residual_mpc.residual.train import train

    task = _task(loaded, case, on, warm_start, form)
    settings = LearnSettings(hidden=layers, passes=passes, step=step, method=method, costs=costs)
    made = train(task, settings, np.random.default_rng(seed), _reporter(), out)
    document = _document(made, task)
    model = _model(made, task, loaded.robot_file.name)
    name_robot_file(model, loaded.robot_file, out)
    write_atomically(out / "model.json", json.dumps(model, allow_nan=False) + "\n")
    write_atomically(out / "learn.json", json.dumps(document, indent=2, allow_nan=False) + "\n")
    checkpoint.clear(out / "checkpoint.npz")
    if as_json:
        emit(document)
    else:
        _summary(document, out)


def _layers(text: str) -> tuple[int, ...]:
    try:
        out = tuple(int(n) for n in text.split(","))
    except ValueError:
        out = ()
    if not out or min(out) < 1 or max(out) > 200:
        raise BadInput(f"{text!r} came, layer sizes such as 10,10 were wanted", "--hidden")
    return out


def _costs(text: str | None) -> tuple[tuple[str, float], ...]:
    out = []
    for part in text.split(",") if text else ():
        channel, _, value = part.partition("=")
        try:
            out.append((channel.strip(), float(value)))
        except ValueError:
            raise BadInput(
                f"{part!r} came, a channel and its cost such as pose.theta=2 were wanted", "--weights"
            ) from None
    return tuple(out)


def _task(loaded: Any, case: str, on: Path | None, warm_start: Path | None, form: str | None) -> "Task":
    from residual_mpc.diagnosis.document import read_model, read_residual
    from residual_mpc.diagnosis.measure import kept_back_of
    from residual_mpc.models.fits import check_fits
    from residual_mpc.residual.train import Task

    values: Any = {}
    leaves_out, held = False, None
    if on is not None:
        of, values, leaves_out = read_model(on)
        check_fits(values, loaded.robots[0], of, str(on))
        held = kept_back_of(on, {r.name for r in loaded.runs})
    earlier = None
    if warm_start is not None:
        earlier = read_residual(warm_start, last=case == "real-to-sim")
        if earlier is None:
            raise BadInput("it holds no learned residual", str(warm_start), "give a model.json that learn wrote")
    return Task(
        loaded.runs, loaded.robots, loaded.noise, case, values, leaves_out, held, earlier,
        str(warm_start or ""), form,
    )  # fmt: skip


def _reporter() -> Any:
    last = monotonic() - 10.0

    def report(update: int, of: int, seconds: float, h2: float) -> None:
        nonlocal last
        if update == of or monotonic() - last > 2.0:
            last = monotonic()
            click.echo(
                f"[{update / of:4.0%}] update {update}/{of}, {seconds:.0f} s of data, H2 norm {h2:.3g}", err=True
            )

    return report


def _document(made: "Learned", task: "Task") -> dict[str, Any]:
    """The `learn` object of the contract and more."""
    import numpy as np

    ms = made.update_ms
    channels = {
        c: {"before": float(b), "after": float(a)}
        for c, b, a in zip(made.channels, made.before.channels, made.after.channels, strict=True)
        if np.isfinite(b)
    }
    condition = made.condition
    return {
        "case": task.case,
        "updates": made.updates,
        "parameters": made.learned.net.size,
        "h2_norm": {
            "first": made.h2.first,
            "last": made.h2.last,
            "held_out_before": made.held_out_h2[0],
            "held_out_after": made.held_out_h2[1],
        },
        "converged_after": made.h2.converged_after,
        "update_ms": {"median": float(np.median(ms)), "p99": float(np.quantile(ms, 0.99))},
        "gap": {
            "before": made.before.total,
            "after": made.after.total,
            "on": "held_out" if made.kept else "training",
            "channels": channels,
            "without_spikes": None
            if made.without_spikes is None
            else {"before": made.without_spikes[0], "after": made.without_spikes[1]},
        },
        "held_out": [k.document() for k in made.kept],
        "form": made.learned.form,
        "step": made.learned.step,
        "inputs": list(made.learned.inputs),
        "outputs": list(made.learned.outputs),
        "chosen_pass": made.chosen_pass,
        "left_alone": list(made.left_alone),
        "worse_on_held_out": list(made.worse_held_out),
        "condition": None
        if condition is None
        else {
            "without": condition.without,
            "with_earlier": condition.with_earlier,
            "holds": condition.holds,
            "kept": made.kept_earlier,
        },
        "seconds": made.seconds,
        "note": NOTE,
    }


def _model(made: "Learned", task: "Task", name: str) -> dict[str, Any]:
    from residual_mpc.diagnosis.document import MODEL_SCHEMA
    from residual_mpc.residual.record import KEY, to_json

    return {
        "schema": MODEL_SCHEMA,
        "robot": name,
        "values": [{**k._asdict(), "value": v} for k, v in task.values.items()],
        "leaves_out_outliers": task.leaves_out_outliers,
        "held_out": [k.document() for k in made.kept],
        KEY: to_json(made.whole),
        f"last_{KEY}": to_json(made.learned),
        "case": task.case,
    }


def _summary(d: dict[str, Any], out: Path) -> None:
    where = "on runs kept back" if d["gap"]["on"] == "held_out" else "on the runs that it was learned from"
    click.echo(f"gap {d['gap']['before']:.3g} -> {d['gap']['after']:.3g} {where}")
    for c, g in d["gap"]["channels"].items():
        click.echo(f"  {c:<24} {g['before']:.3g} -> {g['after']:.3g}")
    h2 = {k: "-" if v is None else f"{v:.3g}" for k, v in d["h2_norm"].items()}
    click.echo(f"  H2 norm {h2['first']} -> {h2['last']}; kept back {h2['held_out_before']} -> {h2['held_out_after']}")
    done = d["converged_after"]
    click.echo("  the H2 norm did not fall" if done is None else f"  converged after {done:.0f} s of data")
    if d["condition"]:
        c = d["condition"]
        said = "is kept" if c["holds"] else "is set to zero"
        click.echo(
            f"  the earlier residual {said}: |x_ref - x_pred| is {c['with_earlier']:.3g} with it, {c['without']:.3g} "
            "without"
        )
    if d["left_alone"]:
        click.echo(f"  got worse on windows set aside, left alone: {', '.join(d['left_alone'])}")
    if d["worse_on_held_out"]:
        click.echo(f"  got worse on runs kept back, left alone: {', '.join(d['worse_on_held_out'])}")
    click.echo(f"  {d['note']}")
    click.echo(f"  model: {out / 'model.json'}")
