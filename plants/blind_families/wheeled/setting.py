"""What is drawn of a rover's case before any effect: rover, runs and sensors; and what effects show on them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from plants.blind_families.planting import needed
from plants.blind_families.sensing import Roughness, draw_roughness, stamps
from plants.blind_families.strength import planar_ratio
from plants.blind_families.wheeled import motions
from plants.blind_families.wheeled.effects import NO_ENCODERS, NO_JERKS, PLANTINGS, REVERSALS, PoseSensor, Rover
from plants.blind_families.wheeled.truth import Policy, Trajectory, WheeledTruth, simulate
from residual_mpc.blind.levels import Level

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Plan:
    """What one run is told: stamps (n,) s, planned forward speed and yaw rate (n,)."""

    name: str
    t: Array
    forward: Array  # m/s
    yaw: Array  # rad/s


@dataclass(frozen=True)
class Setting:
    """Everything of a case that is no effect."""

    rover: Rover  # without any effect
    plans: tuple[Plan, ...]
    sigma: tuple[float, float]  # m, rad
    encoders: bool
    encoder_sigma: float  # rad/s
    feedback: bool
    rough: Roughness
    table: str  # csv or parquet


def draw_setting(level: Level, effects: tuple[str, ...], straight: bool, rng: np.random.Generator) -> Setting:
    """Everything of a case that is no effect."""
    radius = float(np.exp(rng.uniform(np.log(0.03), np.log(0.15))))
    track = float(radius * rng.uniform(3.0, 6.0))
    speed, turn = float(rng.uniform(0.3, 0.8)), float(rng.uniform(0.9, 1.8))
    rate = float(rng.choice([20, 25, 30, 40, 50]))
    rough = draw_roughness(rng) if level.rough else Roughness()
    if straight:
        kinds: list[motions.Motion] = [motions.straight, motions.straight, motions.straight]
    else:
        others = [motions.waves, motions.figure_eight, motions.reversals]
        kinds = [motions.rich, motions.steps, motions.shuttle, others[rng.integers(3)], motions.spin]
        if needed(PLANTINGS, effects, REVERSALS):
            kinds[3] = motions.reversals
    slow = needed(PLANTINGS, effects, NO_JERKS)
    plans = []
    for number, kind in enumerate(kinds):
        t = stamps(float(rng.uniform(17, 24)), rate, rough, rng)
        v, w = kind(t, speed, turn, rng)
        v = motions.limited(v, t, float(rng.uniform(0.8, 1.6) if slow else rng.uniform(1.5, 5.0)))
        w = motions.limited(w, t, float(rng.uniform(4.0, 12.0)))
        plans.append(Plan(f"run{number + 1}", t, v, w))
    wheel = np.concatenate(
        [np.abs([p.forward - p.yaw * track / 2, p.forward + p.yaw * track / 2]).ravel() for p in plans]
    )
    truth = WheeledTruth(radius, track, speed_scale=float(wheel.max() / radius))
    sigma = (float(rng.uniform(0.001, 0.003)) * level.noise, float(rng.uniform(0.003, 0.008)) * level.noise)
    encoders = bool(rng.random() < 0.5) and not needed(PLANTINGS, effects, NO_ENCODERS) and not straight
    return Setting(
        Rover(truth, PoseSensor()),
        tuple(plans),
        sigma,
        encoders,
        0.004 * truth.speed_scale,
        level.rough,
        rough,
        str(rng.choice(["csv", "parquet"])),
    )


def ratio(rover: Rover, setting: Setting) -> float:
    """What the rover's effects add to the gap, over the noise floor."""
    runs = []
    for plan in setting.plans:
        trajectory = drive(rover, setting, plan, (0.0, 0.0))
        runs.append((plan.t, seen(trajectory, plan.t, rover.sensor), trajectory.command))
    nominal = setting.rover.truth
    return planar_ratio(runs, nominal.wheel_radius, nominal.track_width, setting.sigma)


def drive(rover: Rover, setting: Setting, plan: Plan, play: tuple[float, float]) -> Trajectory:
    """What happens on one run; ``play`` says where each gear stands in its backlash, -0.5 to 0.5."""
    nominal = setting.rover.truth
    return simulate(rover.truth, plan.t, _policy(plan, nominal, setting.feedback), play)


def seen(trajectory: Trajectory, t: Array, sensor: PoseSensor) -> Array:
    """What a noise-free localisation reports at ``t``: (n, 3)."""
    pose = trajectory.pose(t - sensor.delay)
    c, s = np.cos(pose[:, 2]), np.sin(pose[:, 2])
    mx, my = sensor.mounting
    return pose + np.stack([c * mx - s * my, s * mx + c * my, np.full(len(t), sensor.bias)], axis=1)


def _policy(plan: Plan, truth: WheeledTruth, feedback: bool) -> Policy:
    """Wheel commands of a run: the plan, or the plan with a path follower's corrections."""
    dt = np.diff(plan.t, append=plan.t[-1])
    heading = np.concatenate([[0.0], np.cumsum(plan.yaw * dt)[:-1]])
    x = np.concatenate([[0.0], np.cumsum(plan.forward * np.cos(heading) * dt)[:-1]])
    y = np.concatenate([[0.0], np.cumsum(plan.forward * np.sin(heading) * dt)[:-1]])

    def policy(k: int, px: float, py: float, ptheta: float) -> tuple[float, float]:
        v, w = plan.forward[k], plan.yaw[k]
        if feedback and plan.t[k] > motions.REST:
            c, s = np.cos(ptheta), np.sin(ptheta)
            along, across = c * (x[k] - px) + s * (y[k] - py), -s * (x[k] - px) + c * (y[k] - py)
            v += np.clip(1.0 * along, -0.2, 0.2)
            w += np.clip(2.0 * v * across + 0.8 * np.sin(heading[k] - ptheta), -0.8, 0.8)
        half = 0.5 * truth.track_width * w
        return float((v - half) / truth.wheel_radius), float((v + half) / truth.wheel_radius)

    return policy
