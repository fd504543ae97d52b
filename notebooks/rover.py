"""What the notebooks begin with: a rover that is not what its model says, and a folder to work in.

The rover stands in for a robot on your desk: a MuJoCo simulation with sensor noise. Its model is the paper's equation
with nominal figures, in `rover.toml`. What sets the two apart is `HIDDEN`, which no model is told of.
"""

import os
import shutil
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from plants.sensors import Sensor
from plants.simulator import Recording, record, write_run
from plants.wheeled.motions import Reference, back_and_forth, figure_eight, policy, spin_in_place
from plants.wheeled.simulators import TURTLEBOT, mujoco_drive
from plants.wheeled.twin import Withheld, encoders, twin

DT = 0.05  # s, a row of the log and a command
HIDDEN = Withheld(ratio=1.04, track=1.1, lag=0.15)
LOCALISATION = Sensor({"pose.x": 0.002, "pose.y": 0.002, "pose.theta": 0.006})  # m, m, rad, at every row
ROVER = twin(mujoco_drive(), HIDDEN, (LOCALISATION, encoders()))
MOTIONS = (figure_eight(0.8, 10.0), spin_in_place(), back_and_forth())

_HERE = Path(__file__).resolve().parent
_folders: list[tempfile.TemporaryDirectory[str]] = []  # kept until the kernel ends, then removed


def workshop() -> None:
    """A fresh folder with `rover.toml` in it, which is the working folder from here on; gone when the kernel ends."""
    _folders.append(tempfile.TemporaryDirectory(prefix="rover-", ignore_cleanup_errors=True))
    folder = Path(_folders[-1].name)
    shutil.copy(_HERE / "rover.toml", folder)
    os.chdir(folder)
    # `residual-mpc` lies beside the kernel's Python, also where that environment was not activated
    os.environ["PATH"] = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])


def drive(folder: str, motions: Sequence[Reference] = MOTIONS, seconds: float = 12.0) -> None:
    """Drive the rover through motions, open loop by its nominal figures, and log each as FOLDER/<motion>.csv."""
    for seed, motion in enumerate(motions):
        send = policy(motion, TURTLEBOT, DT)
        table = record(ROVER, send, Recording(seconds, DT, {}), np.random.default_rng(seed))
        write_run(table, Path(folder) / f"{motion.name}.csv")
