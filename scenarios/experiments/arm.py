"""The paper's experiments A to D on the SCALER arm."""

from dataclasses import dataclass

import numpy as np

from plants.scaler_arm.engines.pybullet_arm import PybulletArm
from plants.scaler_arm.kinematics.geometry import MOTORS
from plants.scaler_arm.motions import CircleWithHeight, CircleWithLine, Motion
from plants.scaler_arm.twin import ENCODERS, twin
from plants.scaler_arm.withheld import draw_withheld
from plants.sensors import Sensed
from plants.simulator import Simulator
from residual_mpc.learning.forms.task import FORM, task_names
from residual_mpc.learning.network.residual import Residual
from residual_mpc.learning.stream.updates import StreamSettings
from scenarios.experiments.arm_data import drive, samples, simulated
from scenarios.experiments.experiment import Experiment
from scenarios.experiments.scenario import LearningScenario
from scenarios.experiments.setting import Setting, learn

SECONDS = 150.0  # of data in an experiment
BEFORE = 60.0  # s of data in a case that an experiment builds on
FRESH = 30.0  # s of data that nothing learns from
NOISE = 0.002  # m/s, of a tool velocity by the encoders over one sample

# The paper gives neither size nor time: plants/scaler_arm's sizes, in rounds of 10 s, whole in every mean over 10 s
LINE = CircleWithLine(period=5.0, line=5.0)
HEIGHT = CircleWithHeight(period=10.0)
MOTIONS: dict[str, Motion] = {"A": LINE, "B": LINE, "C": LINE, "D": HEIGHT}


def feedback() -> Simulator:
    """The paper's simulator: PyBullet with its in-built position control."""
    return Sensed(PybulletArm(), (ENCODERS,))


def robot(seed: int) -> Simulator:
    """The real arm's stand-in: MuJoCo, every seed another one, localised by its encoders as in the paper."""
    return twin("mujoco", draw_withheld(np.random.default_rng(1 + seed)), (ENCODERS,))


@dataclass(frozen=True)
class ArmCase:
    """Builds the setting of an experiment; letter: the paper's."""

    letter: str

    def __call__(self, form: str, seed: int, low_pass: float) -> Setting:
        return _setting(self.letter, seed, SECONDS)


SETTINGS = StreamSettings(noise=(NOISE,))


def _setting(letter: str, seed: int, seconds: float) -> Setting:
    """A begins from nothing, B from d1 of A, C and D from d2 of B."""
    source = feedback() if letter == "A" else robot(seed)
    stream = ord(letter) - ord("A")
    made = []
    for part, length in enumerate((seconds, FRESH)):
        run = drive(source, MOTIONS[letter], length, np.random.default_rng((seed, stream, part)))
        made.append(samples(run, simulated(run) if letter in "CD" else None))
    earlier = None if letter == "A" else _before("A" if letter == "B" else "B", seed)
    return Setting(made[0], made[1], task_names(MOTORS), FORM, "scaler_arm", earlier)


def _before(letter: str, seed: int) -> Residual:
    return learn(_setting(letter, seed, BEFORE), SETTINGS, np.random.default_rng(seed)).streamed.residual


def _experiment(letter: str, case: str, summary: str) -> LearningScenario:
    return LearningScenario(Experiment(
        f"arm_{letter.lower()}", summary, case, "scaler_arm", ArmCase(letter), SETTINGS, (FORM,),
        ("x (m/s)", "y (m/s)", "z (m/s)"), 8.0,
    ))  # fmt: skip


A = _experiment("A", "sim-to-dyn", "learn a simulated arm's tool velocities: circle with a line through it")
B = _experiment("B", "real-to-dyn", "learn the real arm's tool velocities: the same motion")
C = _experiment("C", "real-to-sim", "correct the simulated arm by the real one: the same motion")
D = _experiment("D", "real-to-sim", "the same on a circle that goes up and down")
