"""What is drawn of an arm's case before any effect: arm, runs and sensors; and what effects show on them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from plants.blind_families.arm import motions
from plants.blind_families.arm.effects import ArmRobot, ArmSensor
from plants.blind_families.arm.model import Arm, draw_arm, inertia_at
from plants.blind_families.arm.runs import ReferenceMotion, gap_ratio, play, play_robot, replay, replayed_gap
from plants.blind_families.arm.truth import STEP, ideal, inside
from plants.blind_families.sensing import Roughness, draw_roughness, draw_wild, stamps
from residual_mpc.blind.levels import Level

Array = NDArray[np.float64]
_SPEED_NOISE = 0.02  # rad/s, of logged joint speeds
_LATEST = 0.0005  # s, of an encoder of 1 mrad at 1 rad/s
SIZES = (0.12, 5.0)  # of the lengths beside those of a usual arm: 5 g to 500 kg
_SPIN_UP = 0.7  # s, reference held at home at the start of a run


@dataclass(frozen=True)
class Setting:
    """Everything of a case that is no effect."""

    robot: ArmRobot  # without any effect
    motion: ReferenceMotion
    sigma: Array  # (n,) rad
    resolution: float  # rad, of the encoders
    rough: Roughness
    velocities: bool
    speed_sigma: float  # rad/s
    drops: bool
    table: str  # csv or parquet


def draw_setting(level: Level, rng: np.random.Generator) -> Setting | None:
    """Everything of a case that is no effect; None where the arm runs away."""
    arm = draw_arm(rng, float(np.exp(rng.uniform(*np.log(SIZES))))) if level.wild else draw_arm(rng)
    n = len(arm.axes)
    rate = _rate(arm, level, rng) if level.wild else 0.0
    rough = draw_roughness(rng) if level.rough else draw_wild(rate, _LATEST, rng) if level.wild else Roughness()
    drops = bool(rng.random() < 0.5)
    motion = _motion(arm, level, replace(rough, resolution=0.0), rate, drops, rng)
    sigma = np.full(n, float(rng.uniform(0.0008, 0.0015))) * level.noise
    nothing = ArmSensor(np.zeros(n), np.zeros(n), np.zeros(n))
    happened = play(ideal(arm), motion)
    if happened is None:
        return None
    speed = happened.speed(motion.t, nothing)
    scale = np.sqrt((happened.torque**2).mean(axis=(0, 1)))
    robot = ArmRobot(
        ideal(arm),
        nothing,
        np.quantile(np.abs(happened.torque), 0.995, axis=(0, 1)),
        scale,
        np.sqrt((speed**2).mean(axis=(0, 1))),
        inertia_at(arm, arm.home),
        np.abs(happened.command).max(axis=(0, 1)),
        motion.reference.max(axis=(0, 1)),
        motion.reference.min(axis=(0, 1)),
    )
    resolution = 2 * np.pi / float(rng.choice([4096, 16384]))
    table = str(rng.choice(["csv", "parquet"]))
    velocities = bool(rng.random() < 0.4)
    return Setting(robot, motion, sigma, resolution, rough, velocities, _SPEED_NOISE, drops, table)


def ratio(robot: ArmRobot, setting: Setting) -> float:
    """What the robot's effects add to the gap, over the noise floor; 0 where the arm cannot have them."""
    if not inside(robot.truth):
        return 0.0
    motion = setting.motion
    happened = play_robot(robot, motion)
    if happened is None:
        return float("inf")
    seen, speed = happened.seen(motion.t, robot.sensor), happened.speed(motion.t, robot.sensor)
    sigma = np.sqrt(setting.sigma**2 + setting.resolution**2 / 12)
    # the slope of a quadratic through five samples; where speeds are logged, the middle value of one
    period = float(np.median(np.diff(motion.t)))
    slope = 0.7 * _SPEED_NOISE * np.ones_like(sigma) if setting.velocities else sigma / (period * np.sqrt(10.0))
    return gap_ratio(setting.robot.truth.arm, motion, seen, speed, happened.command, sigma, slope)


def left(robot: ArmRobot, setting: Setting) -> Callable[[ArmRobot], tuple[float, float]]:
    """The gap that would remain with another arm as the model: (multiple of the noise floor, gap)."""
    motion, sigma = setting.motion, np.sqrt(setting.sigma**2 + setting.resolution**2 / 12)
    happened = play_robot(robot, motion)

    def replayed(model: ArmRobot) -> tuple[float, float]:
        start = motion.reference[:, 0].copy()
        again = None if happened is None else replay(model.truth, motion.t, start, happened.command, motion.on)
        if happened is None or again is None:
            return float("inf"), float("inf")
        seen, foretold = happened.seen(motion.t, robot.sensor), again.seen(motion.t, model.sensor)
        return replayed_gap(motion, seen, foretold, sigma)

    # the windows of ``ratio`` start off by the noise of their first samples, whole runs do not
    by_runs, by_windows = replayed(setting.robot)[0], ratio(robot, setting)

    def of(model: ArmRobot) -> tuple[float, float]:
        over_floor, gap = replayed(model)
        return (over_floor * by_windows / by_runs if by_runs > 0.0 else over_floor), gap

    return of


def _rate(arm: Arm, level: Level, rng: np.random.Generator) -> float:
    """Hz, any at which such actuators are driven"""
    least = {"position": 10.0, "velocity": 50.0, "torque": 125.0}[arm.kind]
    return float(rng.choice([r for r in (10.0, 20.0, 50.0, 100.0, 125.0, 250.0, 500.0, 1000.0) if r >= least]))


def _motion(
    arm: Arm, level: Level, rough: Roughness, rate: float, drops: bool, rng: np.random.Generator
) -> ReferenceMotion:
    """rate: Hz, 0: a usual one."""
    if not rate:
        rate = float(rng.choice([50.0, 62.5, 100.0, 125.0])) if arm.kind == "position" else 125.0
    seconds = float(rng.uniform(*((28, 34) if level.long else (15, 19))))
    t = np.unique(np.round(stamps(seconds, rate, rough, rng) / STEP)) * STEP
    kinds: list[motions.Motion] = [motions.multisine, motions.steps, motions.chirp, motions.sweep]
    if level.rough:
        kinds = [motions.working_day, motions.working_day, motions.multisine, motions.sweep]
    n = len(arm.axes)
    reference = np.stack([arm.home + kind(np.maximum(t - _SPIN_UP, 0.0), n, rng) for kind in kinds])
    on = np.ones_like(reference)
    if drops:
        for begin in np.arange(4.0, t[-1] - 3.0, 5.0):
            on[0, (t >= begin) & (t < begin + 0.8)] = 0.0
    return ReferenceMotion(t, reference, on, 0.8 if level.rough else 0.0)
