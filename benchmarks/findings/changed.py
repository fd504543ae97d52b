"""Finding 2: a gain that falls in mid-run, and a radius that grows with the speed: no effect of the list is either."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.findings.noise import PoseNoise
from benchmarks.findings.records import Case, Truth, write_drive
from benchmarks.findings.wheels import Drive, Plan, Sensors, write_runs

SEED = 44000
RADIUS, TRACK = 0.05, 0.24  # m
SAG = "`effects`: voltage_sag at 0.97"


@dataclass(frozen=True)
class Change:
    """The gains of left and right from the middle of each run on, or the growth of the radius (s)."""

    name: str
    said: str
    gains: tuple[float, float] = (1.0, 1.0)
    growth: float = 0.0
    encoders: bool = False


ROWS = (
    Change("both_half", SAG, (0.5, 0.5)),
    Change("both_half_encoders", SAG, (0.5, 0.5), encoders=True),
    Change("both_07", SAG, (0.7, 0.7)),
    Change("left_half", SAG, (0.5, 1.0)),
    Change("left_07", SAG, (0.7, 1.0)),
    Change("left_07_encoders", SAG, (0.7, 1.0), encoders=True),
    Change("radius_grows", "`effects`: a gain", growth=0.025),
    Change("radius_grows_encoders", "`effects`: a gain", growth=0.025, encoders=True),
)


def cases() -> list[Case]:
    """One case a row."""
    return [Case(f"changed_{row.name}", 2, partial(make, row, SEED + k)) for k, row in enumerate(ROWS)]


def make(row: Change, seed: int, folder: Path, _: Path) -> None:
    """Write one of them; where the gain falls, it does so between 40 and 60 % of each run."""
    rng = np.random.default_rng(seed)
    noise = PoseNoise(rng.uniform(0.002, 0.004), rng.uniform(0.003, 0.006))
    sensors = Sensors(50.0, noise=noise, encoders=row.encoders, encoder=0.02)
    robot = Drive(RADIUS, TRACK, gain_after=row.gains, growth=row.growth)
    kinds = rng.choice(["multisine", "steps", "arcs", "smooth"], 3, replace=False)
    plans = [Plan(str(kind), 40.0, rng.uniform(6, 9)) for kind in kinds]
    planted: dict[str, Any] = {"x_radius_grows": {"rate": row.growth}}
    if not row.growth:
        plans = [replace(plan, changes_at=rng.uniform(16, 24)) for plan in plans]
        planted = {"x_gain_change": {"left": row.gains[0], "right": row.gains[1]}}
    write_drive(folder, RADIUS, TRACK)
    write_runs(folder, robot, sensors, plans, rng, 25.0)
    Truth("changed", planted, encoders=row.encoders, said=row.said).write(folder)
