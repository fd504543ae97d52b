"""The paper's experiments A to E on the wheeled robot."""

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from plants.sensors import Sensed, Sensor
from plants.simulator import Simulator
from plants.wheeled.motions import Reference, back_and_forth, changing_yaw_rate, constant_yaw_rate, spin_in_place
from plants.wheeled.simulators import TURTLEBOT, bullet_drive, mujoco_drive
from plants.wheeled.twin import camera, draw_withheld, encoders, twin
from residual_mpc.learning.network.residual import Residual
from residual_mpc.learning.stream.updates import StreamSettings
from scenarios.experiments.experiment import Experiment
from scenarios.experiments.scenario import LearningScenario
from scenarios.experiments.setting import Setting, learn
from scenarios.experiments.wheeled_data import NAMES, drive, samples, simulated

SECONDS = 150.0  # of data in an experiment
BEFORE = 60.0  # s of data in a case that an experiment builds on
FRESH = 30.0  # s of data that nothing learns from
SPIKES = 0.2  # 1/s: wrong estimates of the real robot's localisation
NOISE = (0.02, 0.02, 0.06)  # m/s, m/s, rad/s, the camera's
QUIET = (0.004, 0.004, 0.012)  # what the simulator's own state feedback shakes by
STEP = 0.002  # s, the engines'

# The paper gives levels and no times. A round of 10 s, so that every mean over 10 s holds a whole one.
MOTIONS: dict[str, Reference] = {
    "A": spin_in_place(2.0, 10.0),
    "B": back_and_forth(0.2, 10.0),
    "C": changing_yaw_rate(1.0, 2.5),
    "D": changing_yaw_rate(1.0, 2.5),
    "E": constant_yaw_rate(1.0),
}
if TYPE_CHECKING:
    import pandas as pd

FORMS = ("body", "paper")


def simulator() -> Simulator:
    """What a good simulator knows and the paper's equation does not: motors that need 60 ms, bearings that rub."""
    wheel = replace(TURTLEBOT.left, lag=0.06, kinetic=0.01, static=0.01)
    return mujoco_drive(replace(TURTLEBOT, left=wheel, right=wheel), step=STEP)


def feedback() -> Simulator:
    """The simulator's state as a learner gets it."""
    own = {f"twist.{a}": s for a, s in zip(("x", "y", "theta"), QUIET, strict=True)}
    return Sensed(simulator(), (Sensor({**own, "pose.x": 0.0, "pose.y": 0.0, "pose.theta": 0.0}), encoders()))


def robot(seed: int) -> Simulator:
    """The real robot's stand-in: the other engine, every seed another one, seen by a camera that jumps."""
    withheld = draw_withheld(np.random.default_rng(1 + seed))
    return twin(bullet_drive(step=STEP), withheld, (camera(SPIKES), encoders()))


@dataclass(frozen=True)
class Wheeled:
    """Builds the setting of an experiment; letter: the paper's."""

    letter: str

    def __call__(self, form: str, seed: int, low_pass: float) -> Setting:
        return _setting(self.letter, form, seed, low_pass, SECONDS)


def settings(letter: str, low_pass: float) -> StreamSettings:
    return StreamSettings(noise=QUIET if letter in "AB" else NOISE, low_pass=low_pass)


def _setting(letter: str, form: str, seed: int, low_pass: float, seconds: float) -> Setting:
    """A and B begin from nothing, C and D from d1 of A, E from d2 of D."""
    made = []
    for part, length in enumerate((seconds, FRESH)):
        run, model = _recorded(letter, seed, part, length)
        made.append(samples(run, form, model))
    earlier = None if letter in "AB" else _before("D" if letter == "E" else "A", form, seed, low_pass)
    return Setting(made[0], made[1], NAMES[form], form, "two_wheels", earlier)


@lru_cache(maxsize=8)
def _recorded(letter: str, seed: int, part: int, seconds: float) -> "tuple[pd.DataFrame, np.ndarray | None]":
    """A run, and the simulator's velocities where it is the current model; the forms share them."""
    source = feedback() if letter in "AB" else robot(seed)
    rng = np.random.default_rng((seed, ord(letter) - ord("A"), part))
    run = drive(source, MOTIONS[letter], seconds, rng)
    return run, simulated(run, simulator()) if letter == "E" else None


def _before(letter: str, form: str, seed: int, low_pass: float) -> Residual:
    low_pass = low_pass if letter == "D" else 0.0
    setting = _setting(letter, form, seed, low_pass, BEFORE)
    return learn(setting, settings(letter, low_pass), np.random.default_rng(seed)).streamed.residual


def _experiment(letter: str, case: str, summary: str, low_pass: float = 0.0) -> LearningScenario:
    return LearningScenario(Experiment(
        f"wheeled_{letter.lower()}", summary, case, "diff_drive", Wheeled(letter), settings(letter, low_pass), FORMS,
        ("forward (m/s)", "sideways (m/s)", "yaw rate (rad/s)"), 17.0, letter in "CDE",
    ))  # fmt: skip


A = _experiment("A", "sim-to-dyn", "learn a simulator's velocities: turning on the spot, -2 to 2 rad/s")
B = _experiment("B", "sim-to-dyn", "learn a simulator's velocities: back and forth, -0.2 to 0.2 m/s")
C = _experiment("C", "real-to-dyn", "learn the real robot's velocities: changing yaw rate, no filter")
D = _experiment("D", "real-to-dyn", "the same with the low-pass filter on the network's output", 0.3)
E = _experiment("E", "real-to-sim", "correct the simulator by the real robot: constant yaw rate, filtered", 0.3)
