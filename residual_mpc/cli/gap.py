"""`residual-mpc gap`."""

from pathlib import Path

import click

from residual_mpc.cli.common import emit, horizon_option, json_option, read, robot_option, runs_argument, seed_option


@click.command()
@robot_option
@runs_argument
@click.option(
    "--model",
    type=click.Path(path_type=Path),
    help="Also measure the model in this diagnosis.json or model.json.",
)
@click.option(
    "--held-out-of",
    type=click.Path(path_type=Path),
    help="Measure only on the runs or blocks held out in this diagnosis.json or model.json.",
)
@horizon_option
@json_option
@seed_option
def gap(
    robot: str,
    runs: tuple[str, ...],
    model: Path | None,
    held_out_of: Path | None,
    horizon: float,
    as_json: bool,
    seed: int,
) -> None:
    """Measure the gap: the prediction error over the horizon, relative to the motion.

    With the default horizon, 0.10 means that the model misses a tenth of the motion in one second. A model that
    predicts no motion scores about 1.
    """
    nominal, logged = read(robot, runs)

    from residual_mpc.api.gap import measure_gap

    found = measure_gap(nominal, logged, model=model, held_out_of=held_out_of, horizon=horizon, seed=seed)
    if as_json:
        emit(found.document)
        return
    for line in found.lines():
        click.echo(line)
