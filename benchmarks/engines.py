"""How far the two physics engines differ on the paper's two robots: `python -m benchmarks.engines`.

Without sensor noise and with nothing withheld. The drive: where each engine ends after the same commands, and the gap
of each model on the runs of each. The arm: the gap of `scaler_arm` on PyBullet's runs, by PyBullet's step and by the
stiffness of the model's servos. The tables of docs/results/differential-drive.md and docs/results/scaler-arm.md.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path

import click
import numpy as np
import pandas as pd

from plants.scaler_arm.engines.pybullet_arm import PybulletArm
from plants.scaler_arm.kinematics.loop_closure import at_posture
from plants.scaler_arm.motions import CircleWithHeight, CircleWithLine, references
from plants.simulator import Recording, record, replaying, write_run
from plants.wheeled.motions import MOTIONS, Reference, policy
from plants.wheeled.simulators import TURTLEBOT, bullet_drive, mujoco_drive
from plants.wheeled.twin import FRAME
from residual_mpc import Gap, load_robot, measure_gap, read_runs

ARM_MOTIONS = {"circle_with_line": CircleWithLine(), "circle_with_height": CircleWithHeight()}
ARM_PERIOD = 0.01  # s
STEPS, STIFFNESSES = (0.01, 0.002), (60.0, 600.0)  # s of PyBullet; N m/rad of the model
SETTLES = 0.1  # s, damping over stiffness of the model's servo, the same for every stiffness
SHOWN = ("position.f", "position.a", "position.shoulder")


@click.command()
@click.option(
    "--robot", "robots", type=click.Choice(["drive", "arm"]), multiple=True, help="Repeatable  [default: both]"
)
@click.option("--seconds", type=click.FloatRange(2.0, 600.0), default=20.0, show_default=True, help="Of a drive's run.")
@click.option("--arm-seconds", type=click.FloatRange(2.0, 600.0), default=32.0, show_default=True)
def engines(robots: tuple[str, ...], seconds: float, arm_seconds: float) -> None:
    """Print the tables."""
    with tempfile.TemporaryDirectory() as folder:
        if "drive" in robots or not robots:
            drive_tables(Path(folder), seconds)
        if "arm" in robots or not robots:
            arm_table(Path(folder), arm_seconds)


def drive_tables(folder: Path, seconds: float) -> None:
    """Differences at the end, then gaps."""
    rng = np.random.default_rng(0)  # nothing here is random
    tables: dict[str, dict[str, pd.DataFrame]] = {}
    for engine, simulator in (("MuJoCo", mujoco_drive()), ("PyBullet", bullet_drive())):
        recording = Recording(seconds, FRAME, {})
        tables[engine] = {m.name: record(simulator, policy(m, TURTLEBOT, FRAME), recording, rng) for m in MOTIONS}
        for name, table in tables[engine].items():
            write_run(table, folder / engine / f"{name}.csv")
    click.echo("| motion | distance, m | turn, rad | difference, mm | mrad |\n| --- | --- | --- | --- | --- |")
    for motion in MOTIONS:
        ends = [tables[engine][motion.name].iloc[-1] for engine in ("MuJoCo", "PyBullet")]
        apart = np.array([ends[0][f"pose.{c}"] - ends[1][f"pose.{c}"] for c in ("x", "y", "theta")])
        distance, turn = driven(motion, seconds)
        position = 1e3 * float(np.hypot(apart[0], apart[1]))
        click.echo(f"| {motion.name} | {distance:.1f} | {turn:.0f} | {position:.2f} | {1e3 * abs(apart[2]):.2f} |")
    click.echo("\n| model | runs of MuJoCo | runs of PyBullet |\n| --- | --- | --- |")
    for model in ("diff_drive", "diff_drive_mujoco", "diff_drive_pybullet"):
        gaps = [gap_on(model, folder / engine).nominal for engine in ("MuJoCo", "PyBullet")]
        click.echo(f"| {model} | {gaps[0]:.4f} | {gaps[1]:.4f} |")


def driven(motion: Reference, seconds: float) -> tuple[float, float]:
    """(m, rad) the wanted motion covers, half of the ramp of `policy` left out at its start."""
    t = np.linspace(0.0, seconds - 0.5, 20001)
    v, w = motion.twist(t)
    return float(np.trapezoid(np.abs(v), t)), float(np.trapezoid(np.abs(w), t))


def gap_on(robot: str, runs: Path) -> Gap:
    model = load_robot(robot)
    return measure_gap(model, read_runs(model, runs))


def arm_table(folder: Path, seconds: float) -> None:
    """The gap of `scaler_arm` on PyBullet's runs."""
    shown = " | ".join(c.rpartition(".")[2] for c in SHOWN)
    click.echo(f"\n| PyBullet's step, ms | stiffness, N m/rad | gap | {shown} |\n| --- | --- | --- | --- | --- | --- |")
    for stiffness in STIFFNESSES:
        file = folder / f"stiffness_{stiffness:g}.toml"
        servo = f"stiffness = {stiffness}\ndamping = {SETTLES * stiffness}\n"
        file.write_text(f'name = "arm"\nplant = "scaler_arm"\n[parameters]\n{servo}')
        for step in STEPS:
            gap = gap_on(str(file), arm_runs(folder / f"step_{step:g}", step, seconds))
            channels: Mapping[str, float] = {
                c["channel"]: c["nominal"] for c in gap.to_frame().query("horizon == 1.0").to_dict("records")
            }
            cells = " | ".join(f"{channels[c]:.4f}" for c in SHOWN)
            click.echo(f"| {1e3 * step:g} | {stiffness:g} | {gap.nominal:.4f} | {cells} |")


def arm_runs(folder: Path, step: float, seconds: float) -> Path:
    """The folder of both motions' runs in PyBullet, recorded once."""
    for name, motion in ARM_MOTIONS.items():
        file = folder / f"{name}.csv"
        if not file.is_file():
            q = references(motion, np.arange(0.0, seconds + 0.5 * ARM_PERIOD, ARM_PERIOD))
            how = Recording(seconds, ARM_PERIOD, at_posture(q[0]))
            write_run(record(PybulletArm(timestep=step), replaying(q, ARM_PERIOD), how, np.random.default_rng(0)), file)
    return folder


if __name__ == "__main__":
    engines()
