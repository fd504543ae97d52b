"""The noise floor against brute force: a perfect robot, logged many times with fresh sensor noise."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from oracles.arms import robot_of, wheel_xml
from oracles.rover_euler import TRACK_WIDTH, WHEEL_RADIUS
from oracles.rover_log import SIGMA, rover_run

from plants.diff_drive import DiffDrive
from residual_mpc.api.gap_figures import gap_figures
from residual_mpc.logs.run import Run
from residual_mpc.models.protocol import Robot
from residual_mpc.models.robot_file import RobotFile

DRAWS = 10


def floor_and_truth(clean: Run, robot: Robot, noise: dict[str, float], step: float = 0.0) -> tuple[float, float]:
    """(root mean square of the stated floors, that of the gaps that perfect logs really show)."""
    rng, stated, seen = np.random.default_rng(0), [], []
    for draw in range(DRAWS):
        columns = dict(clean.columns)
        for c, sigma in noise.items():
            if step:  # the sensor's only fault, at another phase of its counts each time
                columns[c] = np.round(columns[c] / step + (phase := rng.uniform())) * step - phase * step
            else:
                columns[c] = columns[c] + sigma * rng.standard_normal(len(clean.t))
        run = Run("run", clean.t, columns)
        gap = gap_figures([run], [robot], RobotFile("r", "any", noise=noise), 1.0, None, None, draw)
        stated.append(gap["noise_floor"])
        seen.append(gap["nominal"])
    return float(np.sqrt(np.mean(np.square(stated)))), float(np.sqrt(np.mean(np.square(seen))))


@pytest.mark.parametrize("noise", [1.0, 5.0])
def test_of_a_rover(noise: float) -> None:
    clean = rover_run("run", {}, 12.0, seed=1, noise=0.0)
    rover = DiffDrive("rover", WHEEL_RADIUS, TRACK_WIDTH)
    stated, seen = floor_and_truth(clean, rover, {c: noise * s for c, s in SIGMA.items()})
    assert stated == pytest.approx(seen, rel=0.1)


def wheel_run(seconds: float = 12.0, rate: float = 100.0) -> Run:
    """A wheel without friction under steps of torque, in closed form."""
    rng, n = np.random.default_rng(2), int(seconds * rate)
    torque = np.repeat(0.05 * rng.standard_normal(n // 25 + 1), 25)[:n]
    v = np.concatenate([[0.0], np.cumsum(torque[:-1] / 0.02 / rate)])
    q = np.concatenate([[0.0], np.cumsum(v[:-1] / rate + 0.5 * torque[:-1] / 0.02 / rate**2)])
    return Run("run", np.arange(n) / rate, {"command.hub": torque, "position.hub": q, "velocity.hub": v})


@pytest.mark.parametrize("speeds", [True, False])
def test_of_a_wheel_with_and_without_measured_speeds(tmp_path: Path, speeds: bool) -> None:
    """Without them the start's speed comes from the positions' slope, and its error grows over the window."""
    robot, run = robot_of(tmp_path, wheel_xml()), wheel_run()
    noise = {"position.hub": 0.02, "velocity.hub": 0.1}
    columns = dict(run.columns)
    if not speeds:
        del columns["velocity.hub"], noise["velocity.hub"]
    stated, seen = floor_and_truth(Run("run", run.t, columns), robot, noise)
    assert stated == pytest.approx(seen, rel=0.1)


def test_of_a_coarse_encoder(tmp_path: Path) -> None:
    """Quantisation counts as noise: as white noise, which errs on the large side where counts last several samples."""
    robot, run = robot_of(tmp_path, wheel_xml()), wheel_run()
    columns = {c: y for c, y in run.columns.items() if c != "velocity.hub"}
    step = 0.01
    stated, seen = floor_and_truth(Run("run", run.t, columns), robot, {"position.hub": step / np.sqrt(12)}, step)
    assert 0.9 * seen < stated < 1.5 * seen
