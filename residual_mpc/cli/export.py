"""`residual-mpc export`."""

from pathlib import Path

import click

from residual_mpc.cli.common import ROBOT, emit, json_option, seed_option, writable_folder

FORMATS = ("casadi", "c", "jax", "onnx", "mjcf", "urdf", "sysid", "actuators")


@click.command()
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--to", required=True, type=click.Choice(FORMATS), help="Export format.")
@click.option("--robot", metavar="R", help=f"{ROBOT}; defaults to the one named in FILE.")
@click.option("--out", type=click.Path(path_type=Path), help="Output folder; defaults to a folder beside FILE.")
@click.option(
    "--dt", type=click.FloatRange(1e-4, 1.0),
    help="Sample time in seconds; defaults to the network's, without a network to the robot's command period, else "
    "0.05. For `actuators` the step of your simulation; defaults to the model's.",
)  # fmt: skip
@click.option(
    "--smooth", type=click.FloatRange(0.0, 1.0), default=0.0, show_default=True,
    help="Width over which kinks are rounded, for gradient-based solvers; 0 is exact.",
)  # fmt: skip
@json_option
@seed_option
def export(
    file: Path, to: str, robot: str | None, out: Path | None, dt: float | None, smooth: float, as_json: bool, seed: int
) -> None:
    """Export the augmented model in FILE (model.json or diagnosis.json) and report its difference from the source."""
    from residual_mpc.api.model import augment
    from residual_mpc.api.robot import load_robot
    from residual_mpc.export.source import robot_beside
    from residual_mpc.learning.network.written import residual_in
    from residual_mpc.models.model_file import read_written

    source = read_written(file)
    where = out or file.parent / f"export_{to}"
    writable_folder(where)
    nominal = load_robot(robot or robot_beside(source.content, file))
    learned = file if residual_in(source) is not None else None
    result = augment(nominal, file, learned, dt=dt, smooth=smooth).export(to, where, seed, dt)
    if to in ("mjcf", "urdf") and nominal.file.variants:
        click.echo(f"note: the model is {nominal.file.model}; the variants in the robot file are ignored", err=True)
    if as_json:
        emit(result)
        return
    for name, what in result["files"].items():
        click.echo(f"{where / name}: {what}")
    for kind in ("approximated", "left_out"):
        for what in result.get(kind, ()):
            click.echo(f"{kind.replace('_', ' ')}: {what}", err=True)
    if "largest_difference" not in result:
        return
    apart = result["largest_difference"]
    click.echo(f"largest difference from the source over {apart['points']} points: {apart['largest']:.2g}")
    if "from_all_effects" in apart and (result.get("approximated") or result["left_out"]):
        click.echo(f"  from the model with all diagnosed effects: {apart['from_all_effects']:.2g}")
