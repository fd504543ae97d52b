"""Runs of the two-wheeled robot, to be diagnosed or learned from: one CSV a motion, in the folder OUT.

\b
python -m plants.wheeled.record OUT --engine mujoco
python -m plants.wheeled.record OUT --engine pybullet --twin --truth TRUTH.json --seconds 60
"""

import json
from pathlib import Path

import click
import numpy as np

from plants.sensors import Sensed
from plants.simulator import Recording, record, write_run
from plants.wheeled.motions import MOTIONS, policy
from plants.wheeled.simulators import TURTLEBOT, bullet_drive, mujoco_drive
from plants.wheeled.twin import FRAME, draw_withheld, noisy, twin
from residual_mpc.errors import BadInput

ENGINES = {"mujoco": mujoco_drive(), "pybullet": bullet_drive()}
NAMES = tuple(m.name for m in MOTIONS)


@click.command(help=__doc__)
@click.argument("out", type=click.Path(file_okay=False, path_type=Path))
@click.option("--engine", type=click.Choice(list(ENGINES)), default="mujoco", show_default=True)
@click.option("--motion", "motions", type=click.Choice(NAMES), multiple=True, help="Motion; repeatable  [default: all]")
@click.option("--seconds", type=click.FloatRange(0.5, 3600.0), default=60.0, show_default=True)
@click.option(
    "--period", type=click.FloatRange(0.002, 1.0), default=FRAME, help="Sampling period in seconds  [default: 1/30]"
)
@click.option("--twin", "real", is_flag=True, help="Simulate the stand-in for the real robot, with withheld effects.")
@click.option("--truth", "truth_file", type=click.Path(path_type=Path), help="File for the withheld effects.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True)
def main(
    out: Path,
    engine: str,
    motions: tuple[str, ...],
    seconds: float,
    period: float,
    real: bool,
    truth_file: Path | None,
    seed: int,
) -> None:
    robot_rng, runs_rng = np.random.default_rng(seed).spawn(2)
    withheld = draw_withheld(robot_rng)
    simulator: Sensed = twin(ENGINES[engine], withheld) if real else noisy(ENGINES[engine])
    if truth_file is not None and truth_file.resolve().is_relative_to(out.resolve()):
        raise click.UsageError("--truth must not be in the folder of the runs")
    for motion, rng in zip(MOTIONS, runs_rng.spawn(len(MOTIONS)), strict=True):
        if motions and motion.name not in motions:
            continue
        try:
            table = record(simulator, policy(motion, TURTLEBOT, period), Recording(seconds, period, {}), rng)
        except BadInput as error:
            raise click.UsageError(str(error)) from error
        write_run(table, out / f"{motion.name}.csv")
    if real and truth_file is not None:
        truth_file.parent.mkdir(parents=True, exist_ok=True)
        truth_file.write_text(json.dumps(withheld.truth(), indent=2) + "\n")


if __name__ == "__main__":
    main()
