"""Finding 1: robots without a gap under white and coloured localisation noise."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.findings.motions import DRIVES, Rng
from benchmarks.findings.noise import PoseNoise
from benchmarks.findings.records import Case, Truth, write_drive
from benchmarks.findings.wheels import Drive, Plan, Sensors, write_runs

SEED = 41000
COUNT = 60
RATES = (10, 20, 50, 100, 200)  # Hz
KINDS = ("white", "coloured", "mixed")
SAID = "`unknown`, 13 of 13 such robots with coloured noise"


def cases() -> list[Case]:
    """perfect_00 to perfect_59: every rate with every kind of noise, half of them with encoders."""
    return [Case(f"perfect_{k:02d}", 1, partial(make, k)) for k in range(COUNT)]


def make(number: int, folder: Path, _: Path) -> None:
    """Write the case with this number."""
    rng = np.random.default_rng(SEED + number)
    rate, kind = RATES[number % 5], KINDS[number % 3]
    radius = rng.uniform(0.03, 0.15)
    robot = Drive(radius, radius * rng.uniform(3.5, 6.5))
    encoders = (number // 15) % 2 == 1
    sensors = Sensors(
        rate,
        noise=drawn_noise(rng, kind),
        encoders=encoders,
        encoder=rng.uniform(0.01, 0.05),
        encoder_step=rng.choice([0.0, 0.05, 0.1]),
    )
    top = rng.uniform(4.0, 9.0)
    chosen = rng.choice(sorted(DRIVES), 3, replace=False)
    plans = [Plan(str(k), float(rng.integers(20, 41)), top, rests=bool(rng.random() < 0.35)) for k in chosen]
    write_drive(folder, robot.wheel_radius, robot.track_width)
    commands = rng.choice([r for r in (10, 20, 50) if rate % r == 0])  # Hz, so that every change is in the log
    write_runs(folder, exactly(robot), sensors, plans, rng, float(commands))
    Truth("none", encoders=encoders, said=SAID if kind != "white" else "not tried").write(folder)


def drawn_noise(rng: Rng, kind: str) -> PoseNoise:
    """1 to 20 mm, 2 to 20 mrad, evenly in the logarithm; a mixture has a half of each or so."""
    metres, radians = (float(low * (high / low) ** rng.random()) for low, high in ((0.001, 0.02), (0.002, 0.02)))
    rho = rng.uniform(0.3, 0.95)
    if kind == "white":
        return PoseNoise(metres, radians)
    if kind == "coloured":
        return PoseNoise(0.0, 0.0, metres, radians, rho)
    share = rng.uniform(0.3, 0.7)
    return PoseNoise(share * metres, share * radians, metres, radians, rho)


def exactly(robot: Drive) -> Drive:
    """The robot with the digits that its robot file has."""
    return Drive(float(f"{robot.wheel_radius:.6g}"), float(f"{robot.track_width:.6g}"))
