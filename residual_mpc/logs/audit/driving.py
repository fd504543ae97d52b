"""Robots on two wheels: wheel speeds against the pose."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from residual_mpc.logs.audit.facts import RobotFacts
from residual_mpc.logs.audit.follow import (
    Follow,
    clipped_deviations,
    command_on_grid,
    follow,
    on_grid,
    position_on_grid,
)
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
        turns.append(right - left)
        if name == "pose.theta":
            yaw.append(np.gradient(position_on_grid(run, name, dt), dt))
        else:
            yaw.append(on_grid(run, run.columns[name], dt))
    turns, yaw = clipped_deviations(turns, each=False), clipped_deviations(yaw, each=False)
    seen = follow(turns, yaw, dt, REACH)
    if seen is None:
        return []
    least, most = float(seen.correlation.min()), float(seen.correlation.max())
    if least < -CLEAR and most < 0.5 or least < -0.4 and most < 0.0:
        return [
            Finding(
                "warning",
                "sign",
                "",
                name,
                None,
                f"the robot turns against its wheels (correlation {least:.2f}):"
                f" left and right are swapped, or {name} is positive clockwise",
                "swap the wheels under [log] in the robot file, or make the angle positive counter-clockwise",
            )
        ]
    return _odd_runs(name, runs, [follow([u], [y], dt, REACH) for u, y in zip(turns, yaw, strict=True)], dt)


def _odd_runs(name: str, runs: Sequence[Run], each: Sequence[Follow | None], dt: float) -> list[Finding]:
    """Runs whose clock, or whose correlation, is not that of the others."""
    good = [f.lag for f in each if f is not None and f.correlation.max() > 0.8]
    if len(good) < 5:
        return []
    usual = float(np.median(good))
    findings = []
    for run, seen in zip(runs, each, strict=True):
        if seen is None or run.t[-1] - run.t[0] < 10.0:  # too short to say
            continue
        strength, late = float(seen.correlation.max()), seen.lag - usual
        if strength < 0.7 and len(good) > 0.7 * len(each):
            message = f"{name} hardly correlates with the wheel speeds ({strength:.2f}), unlike in most runs"
            findings.append(Finding("info", "weak correlation", run.name, name, None, message))
        elif _clearly_late(seen, usual) and abs(late) > max(0.1, 3.0 * dt):
            word = "later" if late > 0.0 else "earlier"
            message = f"{name} follows the wheels {abs(late) * 1e3:.0f} ms {word} than in the other runs"
            remedy = "align the clocks of this run, or leave it out"
            findings.append(Finding("warning", "clock offset", run.name, name, None, message, remedy))
    return findings


def _clearly_late(seen: Follow, usual: float) -> bool:
    """Whether a run has a peak of its own, and at the others' shift much less."""
    k = seen.best()
    there = int(np.argmin(np.abs(seen.lags - usual)))
    inside = 0 < k < len(seen.lags) - 1
    return bool(inside and seen.correlation[k] > max(0.8, seen.correlation[there] + 0.05))


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
        return [
            Finding(
                "error",
                "degrees",
                "",
                "pose.theta",
                None,
                f"only {share:.0%} of the motion is along the heading, {share_degrees:.0%} if pose.theta is in degrees",
                "multiply pose.theta by pi / 180",
            )
        ]
    norm = np.sqrt((forward @ forward) * (wheels @ wheels))
    cosine = float(forward @ wheels / norm) if norm > 0.0 else 0.0
    if share > 0.8 and cosine < -0.5:
        return [
            Finding(
                "warning",
                "sign",
                "",
                "command.left",
                None,
                f"the robot moves backwards when its wheels turn forwards (correlation {cosine:.2f})",
                "flip the sign of the wheel speeds, or add pi to pose.theta",
            )
        ]
    return []


def _smooth(x: FloatArray) -> FloatArray:
    return np.convolve(np.pad(x, 2, mode="edge"), np.ones(5) / 5.0, mode="valid")
