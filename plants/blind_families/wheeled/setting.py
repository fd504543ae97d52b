"""What is drawn of a rover's case before any effect: rover, runs and sensors; and what effects show on them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from plants.blind_families.planting import needed
from plants.blind_families.sensing import Roughness, draw_roughness, draw_wild, stamps
from plants.blind_families.strength import dead_reckoned, planar_gap
from plants.blind_families.wheeled import motions
from plants.blind_families.wheeled.effects import ENCODERS, EVERY, NO_ENCODERS, NO_JERKS, REVERSALS, PoseSensor, Rover
from plants.blind_families.wheeled.truth import Policy, Simulator, Trajectory, WheeledTruth, simulate
from residual_mpc.blind.levels import Level

Array = NDArray[np.float64]
_LATEST = 0.002  # s
_GOLDEN = 2.4  # rad, by which wheels stand farther round in each run
_WANDER = 0.0005  # s
LONG = 10.0  # s, the horizon of what is slow
_USUAL_RADIUS = 0.067  # m, of the wheels that the usual speeds and noises belong to


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
    horizon: float = 1.0  # s, over which the strength of effects is measured
    simulate: Simulator = simulate


def draw_setting(level: Level, effects: tuple[str, ...], straight: bool, rng: np.random.Generator) -> Setting:
    """Everything of a case that is no effect."""
    least, most = (0.005, 0.4) if level.wild else (0.03, 0.15)  # m: 5 g to 500 kg, or what stands on a desk
    radius = float(np.exp(rng.uniform(np.log(least), np.log(most))))
    size = radius / _USUAL_RADIUS if level.wild else 1.0
    track = float(radius * rng.uniform(3.0, 6.0))
    speed, turn = float(rng.uniform(0.3, 0.8)) * size**0.5, float(rng.uniform(0.9, 1.8))
    rate = _any_rate(rng) if level.wild else float(rng.choice([20, 25, 30, 40, 50]))
    rough = draw_roughness(rng) if level.rough else draw_wild(rate, _LATEST, rng) if level.wild else Roughness()
    if straight:
        kinds: list[motions.Motion] = [motions.straight, motions.straight, motions.straight]
    else:
        others = [motions.waves, motions.figure_eight, motions.reversals]
        kinds = [motions.rich, motions.steps, motions.shuttle, others[rng.integers(3)], motions.spin]
        if needed(EVERY, effects, REVERSALS):
            kinds[3] = motions.reversals
    slow = needed(EVERY, effects, NO_JERKS)
    plans = []
    for number, kind in enumerate(kinds):
        t = stamps(float(rng.uniform(*((40, 60) if level.slow or level.long else (17, 24)))), rate, rough, rng)
        v, w = kind(t, speed, turn, rng)
        v = motions.limited(v, t, float(rng.uniform(0.8, 1.6) if slow else rng.uniform(1.5, 5.0)))
        w = motions.limited(w, t, float(rng.uniform(4.0, 12.0)))
        plans.append(Plan(f"run{number + 1}", t, v, w))
    wheel = np.concatenate(
        [np.abs([p.forward - p.yaw * track / 2, p.forward + p.yaw * track / 2]).ravel() for p in plans]
    )
    truth = WheeledTruth(radius, track, speed_scale=float(wheel.max() / radius))
    noise = level.noise * size**0.5  # a camera sees a small and slow robot from nearby
    sigma = (float(rng.uniform(0.001, 0.003)) * noise, float(rng.uniform(0.003, 0.008)) * level.noise)
    encoders = bool(rng.random() < 0.5) and not needed(EVERY, effects, NO_ENCODERS) and not straight
    encoders = encoders or needed(EVERY, effects, ENCODERS)
    return Setting(
        Rover(truth, PoseSensor()),
        tuple(plans),
        sigma,
        encoders,
        0.004 * truth.speed_scale,
        level.rough or (level.wild and bool(rng.random() < 0.5)),
        rough,
        str(rng.choice(["csv", "parquet"])),
        LONG if level.slow else 1.0,
    )


def _any_rate(rng: np.random.Generator) -> float:
    """Hz"""
    return float(rng.choice([10, 12.5, 20, 33, 60, 100, 200, 500, 1000]))


def ratio(rover: Rover, setting: Setting, horizon: float | None = None) -> float:
    """What the rover's effects add to the gap, over the noise floor; horizon: s, else the setting's."""
    return gap(rover, setting, horizon)[0]


def gap(rover: Rover, setting: Setting, horizon: float | None = None) -> tuple[float, float]:
    """(gap over noise floor, gap) of the nominal model; horizon: s, else the setting's."""
    nominal = setting.rover.truth
    foretold = [
        (t, pose, dead_reckoned(t, command, nominal.wheel_radius, nominal.track_width))
        for t, pose, command in _noise_free(rover, setting)
    ]
    return planar_gap(foretold, setting.sigma, setting.horizon if horizon is None else horizon)


def left(rover: Rover, setting: Setting) -> Callable[[Rover], tuple[float, float]]:
    """The gap that would remain with another rover as the model: (multiple of the noise floor, gap)."""
    runs = _noise_free(rover, setting)

    def of(model: Rover) -> tuple[float, float]:
        foretold = [(t, seen(setting.simulate(model.truth, t, _replayed(u)), t, model.sensor)) for t, _, u in runs]
        return planar_gap(
            [(t, pose, again) for (_, pose, _), (t, again) in zip(runs, foretold, strict=True)], setting.sigma
        )

    return of


def _replayed(command: Array) -> Policy:
    return lambda k, x, y, theta: (float(command[k, 0]), float(command[k, 1]))


def _noise_free(rover: Rover, setting: Setting) -> list[tuple[Array, Array, Array]]:
    """(stamps (n,) s, poses seen (n, 3), commands (n, 2) rad/s) of every run."""
    runs = []
    for plan in setting.plans:
        trajectory = drive(rover, setting, plan, (0.0, 0.0))
        runs.append((plan.t, seen(trajectory, plan.t, rover.at(plan.name)[0].sensor), trajectory.command))
    return runs


def drive(rover: Rover, setting: Setting, plan: Plan, play: tuple[float, float]) -> Trajectory:
    """What happens on one run; ``play`` says where each gear stands in its backlash, -0.5 to 0.5."""
    nominal = setting.rover.truth
    began, change = rover.at(plan.name)
    becomes = None if change is None else (change[0], change[1].truth)
    standing = _GOLDEN * int(plan.name.removeprefix("run")) if any(began.truth.eccentric) else 0.0
    began = replace(began, truth=replace(began.truth, standing=standing))
    return setting.simulate(began.truth, plan.t, _policy(plan, nominal, setting.feedback), play, change=becomes)


def seen(trajectory: Trajectory, t: Array, sensor: PoseSensor) -> Array:
    """What a noise-free localisation reports at ``t``: (n, 3)."""
    true = t - sensor.delay
    if sensor.skew:  # of two clocks that began together; a quartz wanders with its temperature
        true = true / (1.0 + sensor.skew) - _WANDER * np.sin(0.2 * t)
    pose = trajectory.pose(true)
    if true[-1] > trajectory.t[-1]:  # what a slow clock stamps at last came after the log's last command
        end = trajectory.t[-1] - np.array([0.0, 0.01])
        rate = -np.diff(trajectory.pose(end), axis=0)[0] / 0.01
        pose = pose + np.maximum(true - end[0], 0.0)[:, None] * rate
    c, s = np.cos(pose[:, 2]), np.sin(pose[:, 2])
    mx, my = sensor.mounting
    read = pose + np.stack([c * mx - s * my, s * mx + c * my, np.full(len(t), sensor.bias)], axis=1)
    for speed, swing, phase in sensor.wander:
        read[:, 2] += swing * np.sin(speed * t + phase)
    read[:, 2] += sensor.magnetic[0] * np.sin(pose[:, 2] + sensor.magnetic[1])
    for since, dx, dy, dtheta in sensor.relocated:
        read[t >= since] += (dx, dy, dtheta)
    return read


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
