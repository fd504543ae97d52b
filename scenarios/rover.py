"""The wheeled robot of the scenarios: a TurtleBot's size, localised by a camera."""

import numpy as np

from controllers.settings import MpcSettings
from plants.diff_drive import DiffDrive
from residual_mpc.closed_loop.estimator import EstimatorSettings
from residual_mpc.closed_loop.online import OnlineSettings
from residual_mpc.learning.batch.training import Task, train
from residual_mpc.learning.batch.window_updates import LearnSettings
from residual_mpc.learning.forms.body import BODY
from residual_mpc.learning.network.mlp import Mlp, initial_weights
from residual_mpc.learning.network.residual import Residual
from residual_mpc.logs.run import Run
from residual_mpc.models.settings import Values
from scenarios.closed_loop.robot_setup import RobotSetup

ROBOT = DiffDrive("rover", 0.033, 0.16)
NOISE = {"pose.x": 0.002, "pose.y": 0.002, "pose.theta": 0.006}  # m, m, rad
# What an online learner starts from, before any data: a small wheeled robot's speeds, and a tenth of them to learn
TYPICAL = np.array([0.2, 0.05, 1.0, 8.0, 8.0])  # m/s, m/s, rad/s, rad/s, rad/s
TO_LEARN = np.array([0.05, 0.02, 0.3])  # m/s, m/s, rad/s
LIMIT = 3.0  # typical inputs: a velocity that feeds back cannot run away


def train_network(runs: tuple[Run, ...], effects: Values, seed: int) -> Residual:
    """The paper's network, by its UKF, on top of the model with these effects."""
    task = Task(runs, (ROBOT,) * len(runs), NOISE, "real-to-dyn", effects)
    return train(task, LearnSettings(passes=2), np.random.default_rng(seed)).whole


def blank_network(seed: int, dt: float) -> Residual:
    """A network of zero output, as it is before any data."""
    net = Mlp(5)
    inputs = (*(f"previous.{n}" for n in BODY), "command.left", "command.right")
    theta = initial_weights(net, np.random.default_rng(seed))
    return Residual(net, theta, inputs, BODY, np.zeros(5), TYPICAL, TO_LEARN, "body", dt, ROBOT.name, LIMIT)


def rover() -> RobotSetup:
    """The wheeled robot of the scenarios."""
    return RobotSetup(ROBOT, NOISE, EstimatorSettings(), MpcSettings(), train_network, blank_network, OnlineSettings())
