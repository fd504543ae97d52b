"""Robots on two wheels: wheel speeds against the pose."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from residual_mpc.logs.audit.facts import RobotFacts
from residual_mpc.logs.audit.follow import command_on_grid, follow, on_grid, position_on_grid, tame
from residual_mpc.logs.finding import Finding
from residual_mpc.logs.run import FloatArray, Run

REACH = 0.5  # s
CLEAR = 0.7
TURNING = ("pose.theta", "twist.theta")


def check_driving(runs: Sequence[Run], robot: RobotFacts) -> list[Finding]:
    """Left and right, forwards and backwards, degrees: whatever the pose can say about the wheels."""
    if {actuator.name for actuator in robot.actuators} != {"left", "right"}:
        return []
    driven = [run for run in runs if {"left", "right"} <= set(run.actuators)]
    dt = float(np.median([run.period for run in runs]))
    findings = []
    for name in TURNING:
        seen = [run for run in driven if name in run.measured]
        findings += _turning(name, seen, dt) if seen else []
    planar = [run for run in driven if {"pose.x", "pose.y", "pose.theta"} <= set(run.measured)]
    return findings + (_heading(planar, dt) if planar else [])


def _wheels(run: Run, dt: float) -> tuple[FloatArray, FloatArray]:
    return command_on_grid(run, "command.left", dt), command_on_grid(run, "command.right", dt)


def _turning(name: str, runs: Sequence[Run], dt: float) -> list[Finding]:
    turns, yaw = [], []
    for run in runs:
        left, right = _wheels(run, dt)
        turns.append(tame(right - left))
        if name == "pose.theta":
            yaw.append(tame(np.gradient(position_on_grid(run, name, dt), dt)))
        else:
            yaw.append(tame(on_grid(run, run.columns[name], dt)))
    seen = follow(turns, yaw, dt, REACH)
    if seen is None or seen.correlation.min() > -CLEAR or seen.correlation.max() > 0.5:
        return []
    return [Finding(
        "warning", "sign", "", name, None,
        f"the robot turns against its wheels (correlation {seen.correlation.min():.2f}):"
        f" left and right are swapped, or {name} counts clockwise",
        'swap the wheels in [log] of the robot file, or write the angle counter-clockwise',
    )]


def _heading(runs: Sequence[Run], dt: float) -> list[Finding]:
    """The direction in which the robot moves against where it says it points."""
    along, across, along_degrees, forwards = [], [], [], []
    for run in runs:
        x, y = (on_grid(run, run.columns[f"pose.{axis}"], dt) for axis in "xy")
        theta = position_on_grid(run, "pose.theta", dt)
        raw = on_grid(run, run.columns["pose.theta"], dt)
        if not np.all(np.isfinite(x + y + theta)):
            continue
        vx, vy = np.gradient(_smooth(x), dt), np.gradient(_smooth(y), dt)
        left, right = _wheels(run, dt)
        along.append(vx * np.cos(theta) + vy * np.sin(theta))
        across.append(-vx * np.sin(theta) + vy * np.cos(theta))
        along_degrees.append(vx * np.cos(np.radians(raw)) + vy * np.sin(np.radians(raw)))
        forwards.append(left + right)
    if not along:
        return []
    forward, sideways, in_degrees, wheels = map(np.concatenate, (along, across, along_degrees, forwards))
    power = float(forward @ forward + sideways @ sideways)
    if power <= 0.0:
        return []
    # a wheeled robot moves where it points: nearly all of its speed lies along its heading
    share, share_degrees = float(forward @ forward) / power, float(in_degrees @ in_degrees) / power
    if share < 0.7 and share_degrees > 0.9:
        return [Finding(
            "error", "degrees", "", "pose.theta", None,
            f"only {share:.0%} of the motion is along the heading, {share_degrees:.0%} with it in degrees",
            "multiply pose.theta by pi / 180",
        )]
    norm = np.sqrt((forward @ forward) * (wheels @ wheels))
    cosine = float(forward @ wheels / norm) if norm > 0.0 else 0.0
    if share > 0.8 and cosine < -CLEAR:
        return [Finding(
            "warning", "sign", "", "command.left", None,
            f"the robot moves backwards when its wheels turn forwards (correlation {cosine:.2f})",
            "write the wheel speeds with the other sign, or turn pose.theta by pi",
        )]
    return []


def _smooth(x: FloatArray) -> FloatArray:
    return np.convolve(np.pad(x, 2, mode="edge"), np.ones(5) / 5.0, mode="valid")
