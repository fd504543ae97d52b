"""Finding 9: a skid-steered base whose encoders part lag from track, in three long runs or in many of 2 s."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.findings.motions import Array, Rng, drive
from benchmarks.findings.noise import PoseNoise
from benchmarks.findings.records import Case, Truth, write_drive, write_run
from benchmarks.findings.wheels import Drive, Plan, Sensors, logged, write_runs

SEED = 43000
RADIUS, TRACK = 0.165, 0.55  # m
WIDER = 2.4
TOP = 6.0  # rad/s
WINDOW = 2.0  # s
WINDOWS = 200
SENSORS = Sensors(20.0, pose_rate=10.0, noise=PoseNoise(0.004, 0.004), encoders=True, encoder=0.03)
ROUGH = {"wheel_radius": {"scale": 0.85}, "command_delay": {"delay": 0.05}, "rate_limit": {"rate": 7.0}}
SAID = "on such a base: track 3.3 where encoders with lidar say 2.4"


@dataclass(frozen=True)
class Base:
    """The lag (s), the limit of the wheels' speed (rad/s), and whether it is logged in windows of 2 s."""

    lag: float
    limit: float | None
    windows: bool
    rough: bool = False  # wheels that slip by a seventh and more, and accelerate slowly

    @property
    def name(self) -> str:
        parts = [
            "skid",
            f"lag_{self.lag:.1f}".replace(".", ""),
            "limit" if self.limit else "",
            "windows" * self.windows,
            "rough" * self.rough,
        ]
        return "_".join(part for part in parts if part)


BASES = (
    *(Base(lag, limit, windows) for lag in (1.0, 0.3) for limit in (None, 4.5) for windows in (True, False)),
    *(Base(1.0, 4.5, windows, rough=True) for windows in (True, False)),
)


def cases() -> list[Case]:
    """Two lags, with and without a limit, in windows and in long runs."""
    return [Case(base.name, 9, partial(make, base, SEED + k)) for k, base in enumerate(BASES)]


def make(base: Base, seed: int, folder: Path, _: Path) -> None:
    """Write one of them."""
    rng = np.random.default_rng(seed)
    limit = np.inf if base.limit is None else base.limit
    robot = Drive(RADIUS, TRACK, track_scale=WIDER, lag=base.lag, limit=limit, slip=0.04)
    top = TOP
    if base.rough:
        robot, top = replace(robot, slip=0.15, scale=0.85, acceleration=7.0, delay=0.05), 2 * TOP
    write_drive(folder, RADIUS, TRACK)
    if base.windows:
        write_run(folder, "run_windows", windows(robot, top, rng))
    else:
        plans = [Plan(kind, 60.0, top) for kind in ("steps", "multisine", "arcs")]
        write_runs(folder, robot, SENSORS, plans, rng, 20.0)
    planted: dict[str, Any] = {"actuator_lag": {"time_constant": base.lag}, "track_width": {"scale": WIDER}}
    if base.limit is not None:
        planted["saturation"] = {"limit": base.limit}
    background = ROUGH if base.rough else {}
    said = SAID if base.rough else "not tried"
    Truth("skid", planted, background, encoders=True, said=said, within=1.25 if base.rough else 1.1).write(folder)


def windows(robot: Drive, top: float, rng: Rng) -> dict[str, Array]:
    """One table of windows cut from a long drive, each with its pose in the frame of its start."""
    rows = round(WINDOW * SENSORS.rate)
    commands = drive(rng, "steps", WINDOWS * WINDOW, 20.0, top)
    table = logged(robot, SENSORS, commands, 20.0, rng)
    pieces = [
        from_its_start({name: np.array(column[k * rows : (k + 1) * rows]) for name, column in table.items()})
        for k in range(WINDOWS)
    ]
    joined = {name: np.concatenate([piece[name] for piece in pieces]) for name in table}
    return {"run": np.repeat(np.arange(WINDOWS), rows), **joined}


def from_its_start(piece: dict[str, Array]) -> dict[str, Array]:
    """The window with time from 0 and its pose in the frame of its first sample."""
    x, y, theta = (piece[f"pose.{name}"] for name in ("x", "y", "theta"))
    c, s = np.cos(theta[0]), np.sin(theta[0])
    dx, dy = x - x[0], y - y[0]
    pose = {"pose.x": c * dx + s * dy, "pose.y": c * dy - s * dx, "pose.theta": theta - theta[0]}
    return piece | pose | {"t": piece["t"] - piece["t"][0]}
