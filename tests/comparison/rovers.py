"""Runs of one rover before and after something was done to it, from the findings' simulator, which shares no law with
the product."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.findings.noise import PoseNoise
from benchmarks.findings.records import write_drive
from benchmarks.findings.wheels import Drive, Plan, Sensors, write_runs

ROVER = Drive(0.05, 0.30, track_scale=1.06)  # the model's track is too narrow, before and after
SENSORS = Sensors(rate=20.0, noise=PoseNoise(0.002, 0.004), encoders=True, encoder=0.02)
PLANS = (Plan("multisine", 9.0, 8.0), Plan("smooth", 9.0, 8.0), Plan("steps", 9.0, 8.0))


def write_sets(folder: Path, track: float = 1.0, seed: int = 0, plans: tuple[Plan, ...] = PLANS) -> Path:
    """robot.toml, before/ and after/; track: by which the rover's track grew in between."""
    write_drive(folder, ROVER.wheel_radius, ROVER.track_width)
    after = replace(ROVER, track_scale=track * ROVER.track_scale)
    for name, robot, add in (("before", ROVER, 0), ("after", after, 1)):
        (folder / name).mkdir(exist_ok=True)
        write_runs(folder / name, robot, SENSORS, plans, np.random.default_rng([seed, add]), 20.0)
    return folder
