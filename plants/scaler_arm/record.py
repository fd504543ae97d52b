"""Runs of the arm, to be diagnosed or learned from:

\b
python -m plants.scaler_arm.record OUT.csv --engine pybullet --motion circle_with_line --seconds 60
python -m plants.scaler_arm.record OUT.csv --engine mujoco --twin --truth TRUTH.json
"""

import json
from pathlib import Path

import click
import numpy as np

from plants.scaler_arm.engines.mujoco_arm import MujocoArm
from plants.scaler_arm.engines.pybullet_arm import PybulletArm
from plants.scaler_arm.kinematics.loop_closure import at_posture
from plants.scaler_arm.motions import CircleWithHeight, CircleWithLine, Motion, references
from plants.scaler_arm.twin import ENCODERS, twin
from plants.scaler_arm.withheld import TYPICAL, draw_withheld, truth
from plants.sensors import Sensed
from plants.simulator import Recording, Simulator, record, replaying, write_run
from residual_mpc.errors import BadInput

MOTIONS: dict[str, Motion] = {"circle_with_line": CircleWithLine(), "circle_with_height": CircleWithHeight()}
ENGINES: dict[str, Simulator] = {"mujoco": MujocoArm(), "pybullet": PybulletArm()}


@click.command(help=__doc__)
@click.argument("out", type=click.Path(dir_okay=False, path_type=Path))
@click.option("--engine", type=click.Choice(list(ENGINES)), default="pybullet", show_default=True)
@click.option("--motion", type=click.Choice(list(MOTIONS)), default="circle_with_line", show_default=True)
@click.option("--seconds", type=click.FloatRange(0.1, 3600.0), default=60.0, show_default=True)
@click.option(
    "--period", type=click.FloatRange(0.001, 1.0), default=0.01, show_default=True, help="Sampling period in seconds."
)
@click.option("--twin", "real", is_flag=True, help="Simulate the stand-in for the real robot, with withheld effects.")
@click.option("--draw", is_flag=True, help="Draw the withheld effects from the seed instead of using fixed ones.")
@click.option("--truth", "truth_file", type=click.Path(path_type=Path), help="File for the withheld effects.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True)
def main(
    out: Path,
    engine: str,
    motion: str,
    seconds: float,
    period: float,
    real: bool,
    draw: bool,
    truth_file: Path | None,
    seed: int,
) -> None:
    if truth_file is not None and truth_file.resolve().parent == out.resolve().parent:
        raise click.UsageError("--truth must not be in the folder of the run")
    rng = np.random.default_rng(seed)
    withheld = draw_withheld(rng) if draw else TYPICAL
    simulator: Simulator = twin(engine, withheld) if real else Sensed(ENGINES[engine], (ENCODERS,))
    t = period * np.arange(int(seconds / period + 1e-9) + 1)
    commands = references(MOTIONS[motion], t)
    try:
        how = Recording(float(t[-1]), period, at_posture(commands[0]))
        table = record(simulator, replaying(commands, period), how, rng)
    except BadInput as error:
        raise click.UsageError(str(error)) from error
    write_run(table, out)
    if real and truth_file is not None:
        truth_file.parent.mkdir(parents=True, exist_ok=True)
        truth_file.write_text(json.dumps(truth(withheld, engine), indent=2) + "\n")


if __name__ == "__main__":
    main()
