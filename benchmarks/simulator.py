"""What the corrected simulator costs beside bare MuJoCo: `python -m benchmarks.simulator`.

A two-joint arm with position servos, stepped for 20 ms at a time with a diagnosed model's effects in it, and the same
model in `mujoco.batch` with none. CPU time of the process, all its threads together; the two take turns, so that a busy
machine slows both, and what is printed is the ratio of their medians.
"""

import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from statistics import median

import click
import numpy as np

from plants.mujoco_robot import MujocoRobot, build
from residual_mpc.models.robot_file import RobotFile
from residual_mpc.models.settings import Knob, assemble

PERIOD, PERIODS = 0.02, 40  # s that a command is held, and how many of them a turn drives
MODEL = """<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <default><geom contype="0" conaffinity="0"/><joint damping="0.1" armature="0.01"/></default>
  <worldbody><body><joint name="shoulder" axis="0 1 0"/>
    <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.03" mass="0.8"/>
    <body pos="0.3 0 0"><joint name="elbow" axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.02" mass="0.4"/>
  </body></body></worldbody>
  <actuator>
    <position name="shoulder" joint="shoulder" kp="30" kv="1.5"/>
    <position name="elbow" joint="elbow" kp="20" kv="0.8"/>
  </actuator>
</mujoco>"""
NUMBERS = {  # effects that are written into the model once
    "command_delay": {"delay": 0.013},
    "actuator_gain": {"gain": 0.8},
    "saturation": {"limit": 2.5},
    "coulomb_friction": {"torque": 0.15},
    "viscous_friction": {"coefficient": 0.05},
    "armature": {"inertia": 0.004},
    "payload": {"mass": 0.3},
}
REWRITTEN = {  # and such as are written anew before every step
    "voltage_sag": {"rate": 0.15},
    "dead_zone": {"width": 0.04},
    "stribeck_friction": {"static": 0.2, "kinetic": 0.1, "velocity": 0.5},
    "load_dependent_friction": {"coefficient": 0.1},
    "actuator_lag": {"time_constant": 0.03},
}
MODELS: Mapping[str, Mapping[str, Mapping[str, float]]] = {
    "no effect": {},
    "effects that are numbers": NUMBERS,
    "those, and effects rewritten at every step": NUMBERS | REWRITTEN,
}


@click.command()
@click.option("--rows", type=click.IntRange(min=1), multiple=True, default=(256, 1), show_default=True)
@click.option("--turns", type=click.IntRange(min=1), default=9, show_default=True, help="Medians are over these.")
def simulator(rows: tuple[int, ...], turns: int) -> None:
    """Print how fast the corrected simulator runs, as a share of bare MuJoCo's speed and of real time."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "arm.xml")
        path.write_text(MODEL, encoding="utf-8")
        robot = build(RobotFile("arm", "mujoco", model=path))
        click.echo("| model | rows | of bare MuJoCo's speed | simulated s in a CPU s | a period, CPU ms |")
        click.echo("| --- | --- | --- | --- | --- |")
        for name, effects in MODELS.items():
            for count in rows:
                bare, ours = in_turns([bare_of(robot, count), corrected_of(robot, effects, count)], turns)
                each = f"{bare / ours:.2f} | {count * PERIOD / ours:.0f} | {1e3 * ours:.2f}"
                click.echo(f"| {name} | {count} | {each} |")


def bare_of(robot: MujocoRobot, rows: int) -> Callable[[], object]:
    """A period of the nominal model in MuJoCo's own batch."""
    from mujoco.batch import Batch

    batch, steps = Batch(robot.model, rows), round(PERIOD / robot.step)
    batch.reset()
    batch.bind("ctrl")[:] = command()

    def period() -> None:
        for _ in range(steps):
            batch.step()

    return period


def corrected_of(robot: MujocoRobot, effects: Mapping[str, Mapping[str, float]], rows: int) -> Callable[[], object]:
    """A period of the model with these effects."""
    values = {Knob(e, None, p): x for e, ps in effects.items() for p, x in ps.items()}
    stepped = robot.simulator(assemble([values], {e: robot.slots(e) for e in effects}), rows, PERIOD)
    return lambda: stepped.step(command())


def command() -> np.ndarray:
    """(2,) rad"""
    return np.array([0.3, 0.2])


def in_turns(work: list[Callable[[], object]], turns: int) -> list[float]:
    """Median CPU s of a period of each, after one turn that warms up."""
    found: list[list[float]] = [[] for _ in work]
    for turn in range(turns + 1):
        for each, period in zip(found, work, strict=True):
            begin = time.process_time()
            for _ in range(PERIODS):
                period()
            if turn:
                each.append((time.process_time() - begin) / PERIODS)
    return [median(each) for each in found]


if __name__ == "__main__":
    simulator()
