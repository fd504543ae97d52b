"""`residual-mpc export`."""

from pathlib import Path
from typing import Any

import click

from residual_mpc.cli.common import ROBOT, a_number, emit, json_option, read, seed_option, writable_folder
from residual_mpc.cli.many import TakingMany
from residual_mpc.errors import BadInput

MODELS = ("casadi", "c", "jax", "onnx", "mjcf", "urdf", "sysid", "actuators", "servo-table")
RECORDINGS = {"rerun": ".rrd", "mcap": ".mcap"}


@click.command(cls=TakingMany)
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--to", required=True, type=click.Choice((*MODELS, *RECORDINGS)), help="Export format.")
@click.option("--robot", metavar="R", help=f"{ROBOT}; defaults to the one named in FILE.")
@click.option(
    "--out", type=click.Path(path_type=Path),
    help="Output folder; defaults to a folder beside FILE. For one run in `rerun` or `mcap` also a file name.",
)  # fmt: skip
@click.option(
    "--dt", type=click.FloatRange(1e-4, 0.5),
    help="Sample time in seconds; defaults to the network's, without a network to 0.05 (MuJoCo arms: 0.02). "
    "For `actuators` the step of your simulation; defaults to the model's.",
)  # fmt: skip
@click.option(
    "--smooth", type=click.FloatRange(0.0, 1.0), default=0.0, show_default=True,
    help="Width over which kinks are rounded, for gradient-based solvers; 0 is exact.",
)  # fmt: skip
@click.option(
    "--runs", multiple=True, metavar="RUN...",
    help="For `rerun` and `mcap`: the runs to predict; defaults to those of the diagnosis.",
)  # fmt: skip
@click.option(
    "--horizon", type=click.FloatRange(0.05, 60.0), callback=a_number,
    help="For `rerun` and `mcap`: prediction horizon in seconds; defaults to the diagnosis', else 1.",
)  # fmt: skip
@click.option(
    "--beside", multiple=True, metavar="DIAGNOSIS...",
    help="For `servo-table`: other diagnosis.json files of this robot, from other motions, to pool.",
)  # fmt: skip
@json_option
@seed_option
def export(
    file: Path, to: str, robot: str | None, out: Path | None, dt: float | None, smooth: float, runs: tuple[str, ...],
    horizon: float | None, beside: tuple[str, ...], as_json: bool, seed: int,
) -> None:  # fmt: skip
    """Export the augmented model in FILE (model.json or diagnosis.json) and report its difference from the source.

    `servo-table` writes a CSV with a row for each servo: the model's values and the corrected ones, with intervals.
    `rerun` and `mcap` write runs instead: measured, nominal and corrected signals, gap and robot over time.
    """
    if beside and to != "servo-table":
        raise BadInput(f"only --to servo-table takes --beside, got --to {to}", "--beside", "omit --beside")
    if to in RECORDINGS:
        _recordings(file, to, robot, out, runs, horizon, as_json, seed)
        return
    for option, given in (("--runs", runs), ("--horizon", horizon)):
        if given:
            raise BadInput(f"only --to rerun and --to mcap take {option}, got --to {to}", option, f"omit {option}")
    _model(file, to, robot, out, dt, smooth, beside, as_json, seed)


def _model(
    file: Path, to: str, robot: str | None, out: Path | None, dt: float | None, smooth: float, beside: tuple[str, ...],
    as_json: bool, seed: int,
) -> None:  # fmt: skip
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
    result = augment(nominal, file, learned, dt=dt, smooth=smooth).export(to, where, seed, dt, beside)
    if to in ("mjcf", "urdf") and nominal.file.variants:
        click.echo(f"note: the model is {nominal.file.model}; the variants in the robot file are ignored", err=True)
    if _said(result, as_json) or "largest_difference" not in result:
        return
    apart = result["largest_difference"]
    unit = apart["unit"]
    click.echo(f"largest difference from the source over {apart['points']} points: {apart['largest']:.2g} {unit}")
    if "from_all_effects" in apart and (result.get("approximated") or result["left_out"]):
        click.echo(f"  from the model with all diagnosed effects: {apart['from_all_effects']:.2g} {unit}")


def _recordings(
    file: Path, to: str, robot: str | None, out: Path | None, runs: tuple[str, ...], horizon: float | None,
    as_json: bool, seed: int,
) -> None:  # fmt: skip
    from residual_mpc.api.recording import export_runs, runs_of
    from residual_mpc.export.recording.write import check_package
    from residual_mpc.export.source import robot_beside
    from residual_mpc.models.model_file import model_content, read_written

    check_package(to)
    source = read_written(file)
    model_content(source)
    where = out or file.parent / f"export_{to}"
    writable_folder(where.parent if where.suffix.lower() == RECORDINGS[to] else where)
    nominal, logged = read(robot or robot_beside(source.content, file), runs or runs_of(file))
    result = export_runs(nominal, logged, to, where, model=file, horizon=horizon, seed=seed)
    if not _said(result, as_json):
        click.echo(f"noise floor: {result['noise_floor']:.2g}")


def _said(result: dict[str, Any], as_json: bool) -> bool:
    """Print the files and what is missing from them, or everything as JSON, and whether it was all that."""
    if as_json:
        emit(result)
        return True
    for name, what in result["files"].items():
        click.echo(f"{Path(result['folder']) / name}: {what}")
    for kind in ("approximated", "left_out"):
        for what in result.get(kind, ()):
            click.echo(f"{kind.replace('_', ' ')}: {what}", err=True)
    for what in result.get("warnings", ()):
        click.echo(f"warning: {what}", err=True)
    return False
