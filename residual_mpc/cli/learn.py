"""`residual-mpc learn`."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from time import monotonic
from typing import Any

import click

from residual_mpc.cli.common import (
    emit,
    json_option,
    out_option,
    read,
    robot_option,
    runs_argument,
    seed_option,
    writable_folder,
)
from residual_mpc.errors import BadInput


@click.command()
@robot_option
@runs_argument
@out_option("model.json, learn.json, report.html and the checkpoint")
@click.option(
    "--case",
    type=click.Choice(["sim-to-dyn", "real-to-dyn", "real-to-sim"]),
    default="real-to-dyn",
    show_default=True,
    help="SOURCE-to-MODEL: whether the runs come from the simulator or the real robot, and whether R is the dynamic "
    "model or the simulator.",
)
@click.option(
    "--on",
    type=click.Path(path_type=Path),
    help="Learn the residual of the model in this diagnosis.json or model.json.",
)
@click.option(
    "--warm-start",
    type=click.Path(path_type=Path),
    help="Start from the residual in the model.json of the previous case; not allowed for sim-to-dyn.",
)
@click.option(
    "--form",
    type=click.Choice(["body", "paper", "joint"]),
    help="Which velocities the residual corrects, and its inputs.  [default: body for a robot that drives, else joint]",
)
@click.option("--hidden", default="10,10", show_default=True, help="Sizes of the hidden layers.")
@click.option(
    "--method",
    type=click.Choice(["auto", "ukf", "ekf"]),
    default="auto",
    show_default=True,
    help="Kalman filter of the weights: unscented, extended, or chosen by the size of the network.",
)
@click.option("--passes", type=click.IntRange(1, 100), default=5, show_default=True, help="Passes through the data.")
@click.option("--step", type=click.FloatRange(0.001, 1.0), help="Time step of the residual in seconds.")
@click.option(
    "--weights",
    metavar="CHANNEL=C,...",
    help="Weights of the channels' errors (the paper's costs), such as pose.theta=2.",
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
    """Train the residual network of a robot on runs with a Kalman filter and evaluate it on held-out runs.

    If interrupted, the same command resumes from the last checkpoint and arrives at the same weights.
    """
    writable_folder(out)
    layers, costs = _layers(hidden), _costs(weights)
    nominal, logged = read(robot, runs)

    from residual_mpc.api.learning import learn as learn_residual

    with _told_how_to_continue(out):
        learned = learn_residual(
            nominal, logged, on=on, case=case, warm_start=warm_start, form=form, hidden=layers, method=method,
            passes=passes, step=step, weights=costs, seed=seed, out=out, report=_reporter(),
        )  # fmt: skip
    if as_json:
        emit(learned.document)
        return
    for line in (*learned.lines(), f"  model: {out / 'model.json'}", f"  report: {out / 'report.html'}"):
        click.echo(line)


@contextmanager
def _told_how_to_continue(out: Path) -> Iterator[None]:
    """If Ctrl-C stops the training, say that the same command continues from the checkpoint."""
    try:
        yield
    except KeyboardInterrupt:
        from residual_mpc.learning.batch.checkpoint import FILE

        if (out / FILE).is_file():
            click.echo("run the same command again to continue from the last checkpoint", err=True)
        raise


def _layers(text: str) -> tuple[int, ...]:
    try:
        out = tuple(int(n) for n in text.split(","))
    except ValueError:
        out = ()
    if not out or min(out) < 1 or max(out) > 200:
        raise BadInput(f"must be layer sizes from 1 to 200 such as 10,10, got {text!r}", "--hidden")
    return out


def _costs(text: str | None) -> dict[str, float]:
    out = {}
    for part in text.split(",") if text else ():
        channel, _, value = part.partition("=")
        try:
            out[channel.strip()] = float(value)
        except ValueError:
            raise BadInput(
                f"must be a channel and its weight such as pose.theta=2, got {part!r}", "--weights"
            ) from None
    return out


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
