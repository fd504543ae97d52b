"""Differential drives of this benchmark: an ODE at 1 ms of its own, nothing of it shared with the product.

The order is: delay, limit, lag (semi-implicit Euler), change of gain, encoder, slip, ground. The heading follows by the
trapezoid rule, the position from the heading in the middle of a step.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.findings.motions import Array, Rng, drive
from benchmarks.findings.noise import PoseNoise, ar1, quantised, with_outliers
from benchmarks.findings.records import write_run

STEP = 0.001  # s


@dataclass(frozen=True)
class Drive:
    """The robot as it is. Lengths in m, times in s, speeds in rad/s; the neutral values give a perfect robot."""

    wheel_radius: float
    track_width: float
    scale: float = 1.0  # of both wheels
    ratio: float = 1.0  # right over left radius
    track_scale: float = 1.0
    delay: float = 0.0
    lag: float = 0.0
    limit: float = np.inf
    acceleration: float = np.inf  # rad/s^2, the most that the lag lets through
    gain_after: tuple[float, float] = (1.0, 1.0)  # of left and right, from `changes_at` on
    changes_at: float = np.inf
    growth: float = 0.0  # s, a wheel's radius grows by this times its speed
    slip: float = 0.0  # sigma of what a wheel's ground speed varies by, relative


@dataclass(frozen=True)
class Sensors:
    """How the robot is logged; `encoder` is the encoders' sigma and `encoder_step` their resolution (rad/s)."""

    rate: float = 50.0
    pose_rate: float | None = None  # Hz, where the pose comes less often than the log's rows
    noise: PoseNoise = field(default_factory=PoseNoise)
    encoders: bool = False
    encoder: float = 0.0
    encoder_step: float = 0.0
    outliers: float = 0.0


def moved(robot: Drive, commands: Array, command_rate: float, rng: Rng) -> tuple[Array, Array]:
    """Wheel speeds (steps, 2) and poses (steps + 1, 3) at 1 ms under commands held for 1 / command_rate."""
    u = np.repeat(commands, round(1 / command_rate / STEP), axis=0)
    late = round(robot.delay / STEP)
    u = np.concatenate([np.repeat(u[:1], late, axis=0), u])[: len(u)]
    w = lagged(np.clip(u, -robot.limit, robot.limit), robot.lag, robot.acceleration)
    after = np.arange(len(w)) * STEP >= robot.changes_at
    w = np.where(after[:, None], w * np.array(robot.gain_after), w)
    radius = robot.wheel_radius * robot.scale * np.array([1.0, robot.ratio]) * (1 + robot.growth * np.abs(w))
    ground = radius * w
    if robot.slip:
        ground *= 1 + robot.slip * ar1(rng, w.shape, float(np.exp(-STEP / 0.3)))
    return w, rolled(ground, robot.track_width * robot.track_scale)


def lagged(u: Array, time_constant: float, acceleration: float = np.inf) -> Array:
    """Semi-implicit Euler of a first-order lag of limited acceleration that starts at its first input."""
    from scipy.signal import lfilter

    if not time_constant:
        return u
    a = STEP / (time_constant + STEP)
    if np.isinf(acceleration):
        out, _ = lfilter([a], [1.0, a - 1.0], u, axis=0, zi=(1 - a) * u[:1])
        return np.asarray(out)
    return np.stack([_limited(wheel.tolist(), a, acceleration * STEP) for wheel in u.T], axis=1)


def _limited(u: list[float], a: float, most: float) -> Array:
    w = [u[0]]
    for value in u[1:]:
        w.append(w[-1] + min(max(a * (value - w[-1]), -most), most))
    return np.array(w)


def rolled(ground: Array, track: float) -> Array:
    """Poses from the wheels' ground speeds (m/s), from the origin."""
    forward, turn = ground.mean(axis=1), (ground[:, 1] - ground[:, 0]) / track
    theta = np.concatenate([[0.0], np.cumsum(turn) * STEP])
    middle = theta[:-1] + 0.5 * STEP * turn
    x, y = (np.concatenate([[0.0], np.cumsum(forward * f(middle)) * STEP]) for f in (np.cos, np.sin))
    return np.stack([x, y, theta], axis=1)


def logged(robot: Drive, sensors: Sensors, commands: Array, command_rate: float, rng: Rng) -> dict[str, Any]:
    """One run's table."""
    w, pose = moved(robot, commands, command_rate, rng)
    at = np.arange(0, len(w), round(1 / sensors.rate / STEP))
    sent = commands[np.minimum((at * STEP * command_rate + 1e-6).astype(int), len(commands) - 1)]
    read = with_outliers(rng, sensors.noise.added(rng, pose[at]), sensors.outliers)
    if sensors.pose_rate is not None:
        read[np.arange(len(at)) % round(sensors.rate / sensors.pose_rate) != 0] = np.nan
    table = {"t": at * STEP, "command.left": sent[:, 0], "command.right": sent[:, 1]}
    table |= {f"pose.{name}": read[:, k] for k, name in enumerate(("x", "y", "theta"))}
    if sensors.encoders:
        speeds = quantised(w[at] + sensors.encoder * rng.standard_normal((len(at), 2)), sensors.encoder_step)
        table |= {"velocity.left": speeds[:, 0], "velocity.right": speeds[:, 1]}
    return table


@dataclass(frozen=True)
class Plan:
    """The motion of one run; `changes_at` (s), where it is given, is when the gain changes in it."""

    kind: str
    seconds: float
    top: float
    rests: bool = False
    changes_at: float | None = None


def write_runs(
    folder: Path, robot: Drive, sensors: Sensors, plans: Sequence[Plan], rng: Rng, command_rate: float
) -> None:
    """run1, run2, ... into `folder`."""
    for number, plan in enumerate(plans, start=1):
        commands = drive(rng, plan.kind, plan.seconds, command_rate, plan.top, plan.rests)
        now = robot if plan.changes_at is None else replace(robot, changes_at=plan.changes_at)
        write_run(folder, f"run{number}", logged(now, sensors, commands, command_rate, rng))
