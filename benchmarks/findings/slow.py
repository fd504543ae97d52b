"""Finding 6: effects that show over seconds, not over one: unequal wheels, an effective track."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.findings.noise import PoseNoise
from benchmarks.findings.records import Case, Truth, write_drive
from benchmarks.findings.wheels import Drive, Plan, Sensors, write_runs

SEED = 42000
RADIUS, TRACK = 0.033, 0.16  # m
RATIO = "wheel_radius_mismatch"


@dataclass(frozen=True)
class Slow:
    """A robot, what of it is planted, and what 0.1.0 said."""

    name: str
    planted: dict[str, Any]
    said: str
    robot: dict[str, float] = field(default_factory=dict)
    outliers: float = 0.0


ROWS = (
    Slow("ratio_4", {RATIO: {"ratio": 1.04}}, "`no_gap`", {"ratio": 1.04}),
    Slow("ratio_1", {RATIO: {"ratio": 1.015}}, "not tried", {"ratio": 1.015}),
    Slow(
        "ratio_8_late",
        {RATIO: {"ratio": 1.08}, "command_delay": {"delay": 0.08}, "sensor_outliers": {"rate": 0.02}},
        "`effects` without the ratio",
        {"ratio": 1.08, "delay": 0.08},
        0.02,
    ),
    Slow(
        "track_and_ratio",
        {"track_width": {"scale": 1.125}, RATIO: {"ratio": 1.04}},
        "the track alone",
        {"track_scale": 1.125, "ratio": 1.04},
    ),
)


def cases() -> list[Case]:
    """Each robot with and without encoders."""
    rows = [(row, encoders) for row in ROWS for encoders in (False, True)]
    return [
        Case(f"slow_{row.name}{'_encoders' if encoders else ''}", 6, partial(make, row, encoders, SEED + k))
        for k, (row, encoders) in enumerate(rows)
    ]


def make(row: Slow, encoders: bool, seed: int, folder: Path, _: Path) -> None:
    """Write one of them."""
    rng = np.random.default_rng(seed)
    robot = Drive(RADIUS, TRACK, **row.robot)  # type: ignore[arg-type]
    noise = PoseNoise(rng.uniform(0.002, 0.005), rng.uniform(0.003, 0.008))
    sensors = Sensors(50.0, noise=noise, encoders=encoders, encoder=0.02, outliers=row.outliers)
    kinds = rng.choice(["multisine", "steps", "arcs", "smooth"], 3, replace=False)
    plans = [Plan(str(kind), float(rng.integers(30, 41)), rng.uniform(6, 9)) for kind in kinds]
    write_drive(folder, RADIUS, TRACK)
    write_runs(folder, robot, sensors, plans, rng, 25.0)
    Truth("slow", row.planted, encoders=encoders, said=row.said).write(folder)
