"""Robots on two wheels: wheel speeds against the pose."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

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
FASTEST = 3.0  # times the speed that a robot exceeds for a tenth of the time: faster is no motion
ASIDE = 0.2  # rad from the heading, and the share of straight motion along that line, from which the frames may differ
ALIGNED = 0.95
ON_THE_SPOT = 0.2  # of the wheels' turning in opposite directions, up to which they do not drive the robot anywhere
STRAIGHT = 0.2  # of a fast turn, rad/s: slower ones count as straight,
STRAIGHT_POWER = 0.02  # and say something from this share of the squared speed
NEAR = 1.5  # factor within which a ratio of speeds says that a unit is wrong: a wheel's radius may be off as well
# what would set the heading right, and the remedy
THETA = "pose.theta is in degrees", "multiply pose.theta by pi / 180"
XY = "pose.x and pose.y are exchanged", "swap pose.x and pose.y under [log] in the robot file"
MOTORS = "if they are the motors' speeds, divide them by the gear ratio"
UNITS = (  # by how much the robot is then too slow, what is in which unit, and the remedy
    (30.0 / np.pi, "command.left", "rpm", f"multiply the wheel speeds by pi / 30; {MOTORS}"),
    (180.0 / np.pi, "command.left", "deg/s", f"multiply the wheel speeds by pi / 180; {MOTORS}"),
    (1e-3, "pose.x", "mm", "divide pose.x and pose.y by 1000"),
    (1e-2, "pose.x", "cm", "divide pose.x and pose.y by 100"),
)
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
    return findings + (_heading(planar, dt, robot.wheel_radius) if planar else [])


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


@dataclass(frozen=True)
class _Drive:
    """What a robot does, (n,) each: its speed along its heading and to its left, m/s; the same with the heading in
    degrees and with x and y exchanged; the mean of its wheels' commands and their difference, right minus left; how
    fast its heading turns, rad/s."""

    along: FloatArray
    across: FloatArray
    in_degrees: FloatArray
    exchanged: FloatArray
    wheels: FloatArray
    difference: FloatArray
    turning: FloatArray

    @property
    def is_driven(self) -> bool:
        """Whether the wheels' commands drive it and do not only turn it on the spot: then it drifts down a slope."""
        return float(self.wheels @ self.wheels) > ON_THE_SPOT**2 * float(self.difference @ self.difference) / 4.0

    def share(self, along: FloatArray) -> float:
        """Of the motion, that which a speed along the heading holds."""
        return float(along @ along) / max(float(self.along @ self.along + self.across @ self.across), 1e-300)

    def aside(self) -> tuple[float, float]:
        """The angle of straight motion from the heading, rad, positive to the left, and the share of that motion along
        this line, 0 without straight motion. Which of the two ways along it is forwards, the wheels' commands say. In a
        curve, a tracked point beside the wheels' axle moves sideways."""
        turns = (np.abs(x) for x in (self.turning, self.difference))
        straight = np.all([x <= STRAIGHT * np.quantile(x, 0.9) for x in turns], axis=0)
        along, across = self.along[straight], self.across[straight]
        power = float(along @ along + across @ across)
        if power < STRAIGHT_POWER * float(self.along @ self.along + self.across @ self.across):
            return 0.0, 0.0
        angle = float(0.5 * np.arctan2(2.0 * float(along @ across), float(along @ along - across @ across)))
        line = along * np.cos(angle) + across * np.sin(angle)
        if float(line @ self.wheels[straight]) < 0.0:
            angle += np.pi if angle < 0.0 else -np.pi
        return angle, float(line @ line) / max(power, 1e-300)


def _driven(runs: Sequence[Run], dt: float) -> _Drive | None:
    """None where the robot stands. Samples that jump away are left out."""
    found: list[tuple[FloatArray, ...]] = []
    for run in runs:
        x, y = (on_grid(run, run.columns[f"pose.{axis}"], dt) for axis in "xy")
        theta = position_on_grid(run, "pose.theta", dt)
        degrees = np.radians(on_grid(run, run.columns["pose.theta"], dt))
        if not np.all(np.isfinite(x + y + theta)):
            continue
        vx, vy = np.gradient(_smooth(x), dt), np.gradient(_smooth(y), dt)
        left, right = _wheels(run, dt)
        ways = ((vx, vy, theta), (vx, vy, degrees), (vy, vx, theta))
        along, in_degrees, exchanged = (v * np.cos(at) + w * np.sin(at) for v, w, at in ways)
        across, turning = vy * np.cos(theta) - vx * np.sin(theta), np.gradient(_smooth(theta), dt)
        found.append((along, across, in_degrees, exchanged, 0.5 * (left + right), right - left, turning))
    if not found:
        return None
    whole = [np.concatenate(parts) for parts in zip(*found, strict=True)]
    speed = np.hypot(whole[0], whole[1])
    told = np.abs(whole[4]) > 0.0
    usual = FASTEST * float(np.quantile(speed[told] if told.any() else speed, 0.9))
    keep = speed <= usual if usual > 0.0 else np.ones(len(speed), dtype=bool)
    drive = _Drive(*(part[keep] for part in whole))
    return drive if float(drive.along @ drive.along + drive.across @ drive.across) > 0.0 else None


def _heading(runs: Sequence[Run], dt: float, radius: float | None) -> list[Finding]:
    """The direction in which the robot moves against where it says it points, and its speed against its wheels'."""
    drive = _driven(runs, dt)
    if drive is None or not drive.is_driven:
        return []
    # a wheeled robot moves where it points: nearly all of its speed lies along its heading
    share = drive.share(drive.along)
    if share < 0.7 and drive.share(drive.in_degrees) > 0.9:
        return [_elsewhere("degrees", "pose.theta", share, drive.share(drive.in_degrees), *THETA)]
    if share < 0.7 and drive.share(drive.exchanged) > 0.9:
        return [_elsewhere("swapped", "pose.x", share, drive.share(drive.exchanged), *XY)]
    aside, aligned = drive.aside()
    if ASIDE < abs(aside) < np.pi - ASIDE and aligned > ALIGNED:  # the other way round, a sign is reversed
        way = "left" if aside > 0.0 else "right"
        message = (
            f"where it does not turn, the robot moves {abs(aside):.2f} rad to the {way} of its heading: pose.theta and "
            "pose.x, pose.y may be in different frames, or the robot drifts sideways"
        )
        remedy = f"if the frames differ, add {aside:.4g} rad to pose.theta, or rotate pose.x and pose.y by {-aside:.4g}"
        return [Finding("warning", "frames", "", "pose.theta", None, message, remedy)]
    norm = np.sqrt((drive.along @ drive.along) * (drive.wheels @ drive.wheels))
    cosine = float(drive.along @ drive.wheels / norm) if norm > 0.0 else 0.0
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
    return _units(drive, radius) if radius is not None and share > 0.8 and cosine > CLEAR else []


def _elsewhere(kind: str, channel: str, share: float, then: float, if_: str, remedy: str) -> Finding:
    message = f"only {share:.0%} of the motion is along the heading, {then:.0%} if {if_}"
    return Finding("error", kind, "", channel, None, message, remedy)


def _units(drive: _Drive, radius: float) -> list[Finding]:
    """Wheel speeds and positions in units that make the robot far slower or faster than its wheels turn."""
    speed = radius * drive.wheels
    ratio = float(drive.along @ speed) / float(speed @ speed)
    for factor, channel, unit, remedy in UNITS:
        if abs(np.log(ratio * factor)) < np.log(NEAR):
            message = f"the robot drives {ratio:.4g} times as fast as its wheels turn: {channel} may be in {unit}"
            return [Finding("warning", "unit", "", channel, None, message, remedy)]
    return []


def _smooth(x: FloatArray) -> FloatArray:
    return np.convolve(np.pad(x, 2, mode="edge"), np.ones(5) / 5.0, mode="valid")
