"""The robot of the demo: a TurtleBot3 Burger in MuJoCo, on a floor and with motors that its model does not know."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from plants.simulator import Recording, record, write_run
from plants.wheeled.drive import WheeledDrive
from plants.wheeled.engines.geometry import Geometry
from plants.wheeled.motions import MOTIONS, policy
from plants.wheeled.simulators import TURTLEBOT, mujoco_drive
from plants.wheeled.twin import Withheld
from residual_mpc.blind.records import Answer, Planted
from residual_mpc.files import write_atomically
from residual_mpc.models.robot_file import RobotFile
from scenarios.robots import brisk_eight, in_mujoco

PERIOD = 0.05  # s between samples
SECONDS = 20.0  # of a run
DRIVEN = 24.0  # s of the reference
RUNS = ("figure_eight", "route", "spin", "back_and_forth")  # motions
FAINT = ("lateral_slip", "longitudinal_slip")  # tyres that slip a little, in every simulated robot
NAME = "a TurtleBot3 Burger, simulated in MuJoCo"


@dataclass(frozen=True)
class DemoRobot:
    """A robot that differs from its model by what is `withheld`. seed: of its runs."""

    withheld: Withheld
    seed: int

    @property
    def describe(self) -> str:
        return f"{NAME} (wheels of {1e3 * TURTLEBOT.left.radius:g} mm, {1e3 * TURTLEBOT.track:g} mm apart)"

    def answer(self) -> Answer:
        """What is hidden, in the library's words."""
        effects = [Planted(e, target, {p: v}) for (e, target, p), v in self.withheld.effects().items()]
        faint = tuple(Planted(name, None, {}) for name in FAINT)
        return Answer("turtlebot", "turtlebot", "demo", self.seed, tuple(effects), faint)

    def write(self, folder: Path) -> None:
        """What its user has: a robot file and logged runs."""
        sizes = f"wheel_radius = {TURTLEBOT.left.radius:g}  # m\ntrack_width = {TURTLEBOT.track:g}  # m\n"
        robot = f'name = "turtlebot"\nplant = "diff_drive"\n[parameters]\n{sizes}'
        write_atomically(folder / "robot.toml", robot)
        real = in_mujoco(self.withheld)
        motions = {m.name: m for m in MOTIONS}
        for name, rng in zip(RUNS, np.random.default_rng(self.seed).spawn(len(RUNS)), strict=True):
            drive = policy(motions[name], TURTLEBOT, PERIOD)
            write_run(record(real, drive, Recording(SECONDS, PERIOD, {}), rng), folder / f"{name}.csv")

    def write_reference(self, file: Path) -> None:
        """The path that the controllers are to follow, a figure-eight of 12 s."""
        t = PERIOD * np.arange(round(DRIVEN / PERIOD) + 1)
        rows = [",".join(f"{v:.6f}" for v in (s, *pose)) for s, pose in zip(t, brisk_eight().path(t), strict=True)]
        write_atomically(file, "\n".join(["t,pose.x,pose.y,pose.theta", *rows]) + "\n")

    def plant(self, robot: RobotFile, period: float) -> WheeledDrive:
        """The real robot, for a closed loop."""
        return replace(mujoco_drive(), name="turtlebot", geometry=self._geometry())

    def _geometry(self) -> Geometry:
        return self.withheld.applied(TURTLEBOT)


def turtlebot(rng: np.random.Generator) -> DemoRobot:
    """Wheels of two sizes, tyres that scrub in turns, slow motors: each within what such robots show."""
    ratio = 1.0 + rng.choice([-1.0, 1.0]) * rng.uniform(0.025, 0.05)
    withheld = Withheld(ratio=float(ratio), track=float(rng.uniform(1.1, 1.3)), lag=float(rng.uniform(0.1, 0.2)))
    return DemoRobot(withheld, int(rng.integers(2**31)))
