"""The wheeled robot's velocities as the paper's equation wheel_prop has them: model, camera, network inputs."""

from typing import TYPE_CHECKING

import numpy as np

from plants.diff_drive import DiffDrive
from plants.simulator import Recording, Simulator, record, replaying
from plants.wheeled.motions import Reference, policy
from plants.wheeled.simulators import TURTLEBOT
from plants.wheeled.twin import FRAME
from residual_mpc.learning.forms.body import BODY, WORLD
from residual_mpc.learning.stream.samples import Samples

if TYPE_CHECKING:
    import pandas as pd

ROBOT = DiffDrive("two_wheels", TURTLEBOT.left.radius, TURTLEBOT.track)
COMMANDS = ("command.left", "command.right")
Names = tuple[tuple[str, ...], tuple[str, ...]]  # of inputs and outputs

NAMES: dict[str, Names] = {
    "paper": ((*(f"model.{n}" for n in WORLD), *COMMANDS), WORLD),
    "body": ((*(f"previous.{n}" for n in BODY), *COMMANDS), BODY),
}


def drive(simulator: Simulator, motion: Reference, seconds: float, rng: np.random.Generator) -> "pd.DataFrame":
    """A run at the camera's rate, the commands open loop by nominal figures."""
    return record(simulator, policy(motion, TURTLEBOT, FRAME), Recording(seconds, FRAME, {}), rng)


def simulated(run: "pd.DataFrame", simulator: Simulator) -> np.ndarray:
    """(n - 1, 3) body velocities of the simulator under the run's commands, at the run's stamps from the second on."""
    commands = run[list(COMMANDS)].to_numpy()
    seconds = float(run["t"].iloc[-1])
    own = record(simulator, replaying(commands, FRAME), Recording(seconds, FRAME, {}), np.random.default_rng(0))
    twist = own[["twist.x", "twist.y", "twist.theta"]].to_numpy()
    return turned(twist, -own["pose.theta"].to_numpy())[1:]


def samples(run: "pd.DataFrame", form: str, model: np.ndarray | None = None) -> Samples:
    """One sample a row from the second on: what moved the robot then is the command of the row before.

    model (n - 1, 3): body velocities of the current model; None: the paper's equation. The heading is the camera's.
    """
    u = run[list(COMMANDS)].to_numpy()[:-1]
    if model is None:
        rim = ROBOT.wheel_radius * u
        model = np.stack([rim.mean(axis=1), 0.0 * u[:, 0], (rim[:, 1] - rim[:, 0]) / ROBOT.track_width], axis=1)
    heading = run["pose.theta"].ffill().bfill().to_numpy()[1:]
    seen = run[["twist.x", "twist.y", "twist.theta"]].to_numpy()[1:]
    t = run["t"].to_numpy()[1:]
    if form == "paper":
        world = turned(model, heading)
        return Samples(t, np.concatenate([world, u], axis=1), world, seen, FRAME)
    z = np.concatenate([np.zeros_like(model), u], axis=1)
    return Samples(t, z, model, turned(seen, -heading), FRAME, fed_back=True)


def turned(v: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Planar velocities (n, 3) turned by angle (n,) rad."""
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * v[:, 0] - s * v[:, 1], s * v[:, 0] + c * v[:, 1], v[:, 2]], axis=1)
