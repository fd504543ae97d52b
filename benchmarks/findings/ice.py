"""Finding 11: a rover on ice whose measured wheel speeds drive the model: no command is logged, no actuator can err."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.findings.motions import Array, drive
from benchmarks.findings.noise import PoseNoise
from benchmarks.findings.records import Case, Truth, write_drive, write_run
from benchmarks.findings.wheels import STEP, Drive, Sensors, lagged, logged, rolled

SEED = 46000
ROBOT = Drive(0.1, 0.4)
SENSORS = Sensors(50.0, noise=PoseNoise(0.003, 0.004), encoders=True, encoder=0.02)
RATE, SECONDS, TOP = 25.0, 40.0, 8.0  # Hz, s, rad/s
SHARE = 0.64  # of the wheels' speed that the ground sees
MASS, INERTIA, GRIP, STIFF = 12.0, 0.6, 0.08, 60.0  # kg, kg m^2, coefficient of friction, N s/m of a side's slip
SCRUB = 1.5  # N m s/rad against turning
DRIVEN = ("[log]", '"command.left" = "velocity.left"', '"command.right" = "velocity.right"')
NOT_THERE = (
    "command_delay", "dead_zone", "actuator_lag", "actuator_gain", "saturation", "voltage_sag", "backlash",
    "rate_limit", "torque_speed_limit",
)  # fmt: skip
SAID = "every actuator gives 64 %"


def cases() -> list[Case]:
    """Wheels that slip by a fixed share, and tyres of limited grip."""
    return [
        Case("ice_share", 11, partial(make, False, SEED)),
        Case("ice_grip", 11, partial(make, True, SEED + 1)),
    ]


def make(grip: bool, seed: int, folder: Path, _: Path) -> None:
    """Write three runs without a command in them."""
    rng = np.random.default_rng(seed)
    write_drive(folder, ROBOT.wheel_radius, ROBOT.track_width, DRIVEN)
    for number, kind in enumerate(("steps", "multisine", "arcs"), start=1):
        commands = drive(rng, kind, SECONDS, RATE, TOP)
        table = logged(replace(ROBOT, scale=SHARE, slip=0.05, lag=0.1), SENSORS, commands, RATE, rng)
        if grip:
            pose = slid(lagged(np.repeat(commands, round(1 / RATE / STEP), axis=0), 0.1))
            read = SENSORS.noise.added(rng, pose[: -1 : round(1 / SENSORS.rate / STEP)])
            table |= {f"pose.{name}": read[:, k] for k, name in enumerate(("x", "y", "theta"))}
        write_run(folder, f"run{number}", {name: v for name, v in table.items() if not name.startswith("command")})
    if grip:
        Truth("changed", {"x_grip": {"coefficient": GRIP}}, encoders=True, said=SAID, forbidden=NOT_THERE).write(folder)
    else:
        planted = {"wheel_radius": {"scale": SHARE}}
        Truth("single", planted, encoders=True, said=SAID, within=1.1, lacking=True, forbidden=NOT_THERE).write(folder)


def slid(w: Array) -> Array:
    """Poses (steps + 1, 3) of a body whose two sides grip in proportion to their slip, up to a limit; by Euler."""
    r, half, most = ROBOT.wheel_radius, ROBOT.track_width / 2, GRIP * MASS * 9.81 / 2
    v = turn = 0.0
    ground = np.empty_like(w)
    for k, (left, right) in enumerate(w.tolist()):
        ground[k] = v - turn * half, v + turn * half
        pull = [
            min(max(STIFF * (r * s - g), -most), most) for s, g in zip((left, right), ground[k].tolist(), strict=True)
        ]
        v += STEP * (pull[0] + pull[1]) / MASS
        turn += STEP * ((pull[1] - pull[0]) * half - SCRUB * turn) / INERTIA
    return rolled(ground, ROBOT.track_width)
