"""`residual-mpc export`."""

from pathlib import Path

import click

from residual_mpc.cli.common import emit, json_option, seed_option, writable_folder

USUAL_STEP = 0.05  # s, the controllers' usual one


@click.command()
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--to", required=True, type=click.Choice(["casadi", "c", "jax", "onnx", "mjcf"]), help="What to write.")
@click.option("--robot", metavar="R", help="Robot file of the model; by default the one that FILE names.")
@click.option("--out", type=click.Path(path_type=Path), help="Folder for the files; by default beside FILE.")
@click.option(
    "--dt", type=click.FloatRange(1e-4, 1.0),
    help="Sample time of the step, s; by default that at which the network was learned; without one the robot's own "
    "period between commands, else 0.05.",
)  # fmt: skip
@click.option(
    "--smooth", type=click.FloatRange(0.0, 1.0), default=0.0, show_default=True,
    help="Width of rounded kinks, for solvers that converge; 0 is exact.",
)  # fmt: skip
@json_option
@seed_option
def export(
    file: Path, to: str, robot: str | None, out: Path | None, dt: float | None, smooth: float, as_json: bool, seed: int
) -> None:
    """Hand on the augmented model of FILE (model.json or diagnosis.json); says how far it lies from its source."""
    from residual_mpc.diagnosis.document import read_json
    from residual_mpc.export.source import robot_beside

    document = read_json(file)
    where = out or file.parent / f"export_{to}"
    writable_folder(where)
    named = robot or robot_beside(document, file)

    import numpy as np

    from residual_mpc.export.augmented import Build, read_augmented
    from residual_mpc.export.write import write_mjcf, write_model
    from residual_mpc.models.load import load_robot
    from residual_mpc.models.robot_file import read_robot_file

    robot_file = read_robot_file(named)
    robot_model = load_robot(robot_file)
    if to == "mjcf":
        result = write_mjcf(file, robot_model, where)
        if robot_file.variants:
            click.echo(f"note: the model is {robot_file.model}, without what the file's variants change", err=True)
    else:
        at = dt or _step_of(file) or float(getattr(robot_model, "period", USUAL_STEP))
        model = read_augmented(file, robot_model, Build(at, smooth))
        result = write_model(model, to, where, np.random.default_rng(seed))  # type: ignore[arg-type]
    result["folder"] = str(where)
    if as_json:
        emit(result)
        return
    for name, what in result["files"].items():
        click.echo(f"{where / name}: {what}")
    for kind in ("approximated", "left_out"):
        for what in result.get(kind, ()):
            click.echo(f"{kind.replace('_', ' ')}: {what}", err=True)
    apart = result["largest_difference"]
    click.echo(f"largest difference from the source over {apart['points']} points: {apart['largest']:.2g}")
    if "from_all_effects" in apart and (result["approximated"] or result["left_out"]):
        click.echo(f"  from all that was diagnosed: {apart['from_all_effects']:.2g}")


def _step_of(file: Path) -> float | None:
    """The step of the learned network, s; None where there is none."""
    from residual_mpc.diagnosis.document import read_residual

    learned = read_residual(file)
    return None if learned is None else learned.step
