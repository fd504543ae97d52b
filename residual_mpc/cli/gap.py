"""`residual-mpc gap`."""

from pathlib import Path

import click

from residual_mpc.cli.common import emit, horizon_option, json_option, load, robot_option, runs_argument, seed_option


@click.command()
@robot_option
@runs_argument
@click.option(
    "--model",
    type=click.Path(path_type=Path),
    help="A diagnosis.json or model.json, measured beside the nominal model.",
)
@click.option(
    "--held-out-of", type=click.Path(path_type=Path), help="Only the runs or blocks that this diagnosis.json kept back."
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
    """Measure how much of the motion within one horizon the nominal model misses.

    0.10 means that in one second the model misses a tenth of the motion; a model that stands still scores about 1.
    """
    from residual_mpc.diagnosis.measure import measure

    loaded = load(robot, runs)
    document = measure(loaded.runs, loaded.robots, loaded.robot_file, horizon, model, held_out_of, seed)
    if as_json:
        emit(document)
        return
    beside = "" if document["model"] is None else f", {document['model']:.3g} with the model"
    click.echo(
        f"gap {document['nominal']:.3g}{beside} (noise floor {document['noise_floor']:.2g}) "
        f"over {document['windows']} windows of {horizon:g} s"
    )
    for name, c in document["channels"].items():
        beside = "" if c["model"] is None else f" -> {c['model']:.3g}"
        click.echo(f"  {name:<24} {c['nominal']:.3g}{beside}   (noise floor {c['noise_floor']:.2g})")
    if document["still"]:
        click.echo(f"  still, left out: {', '.join(document['still'])}")
    if document["skipped"]:
        click.echo(f"  {document['skipped']} windows skipped: no sample within 0.25 s of their start")
