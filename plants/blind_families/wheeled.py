"""Blind cases of a wheeled robot: two driven wheels, a localisation, sometimes encoders."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from plants.blind_families import wheeled_motions as motions
from plants.blind_families.sensing import (
    Roughness,
    draw_roughness,
    noisy,
    outlier_mask,
    quantised,
    stamps,
    with_dropouts,
)
from plants.blind_families.strength import planar_ratio, tuned
from plants.blind_families.wheeled_effects import PLANT, TYPICAL, Draw, PoseSensor, Rover, draw_effect
from plants.blind_families.wheeled_truth import Policy, Trajectory, WheeledTruth, simulate
from residual_mpc.blind.levels import Level
from residual_mpc.blind.records import Answer, Planted
from residual_mpc.blind.twins import may_be_withheld, twins_of

Array = NDArray[np.float64]
UNKNOWN = ("eccentric_wheel", "one_sided_turning", "warming_up", "gusts")
STRONG = 7.0  # ratio to the noise floor of a usual strong effect
_ATTEMPTS = 40  # draws of effects before a level is given up


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


def _setting(level: Level, effects: tuple[str, ...], straight: bool, rng: np.random.Generator) -> Setting:
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
        if {"dead_zone", "backlash"} & set(effects):
            kinds[3] = motions.reversals
    slow = "longitudinal_slip" in effects  # a robot that slides is not driven with jerks
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
    encoders = bool(rng.random() < 0.5) and "backlash" not in effects and not straight
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


def _drive(rover: Rover, setting: Setting, plan: Plan, play: tuple[float, float]) -> Trajectory:
    nominal = setting.rover.truth
    return simulate(rover.truth, plan.t, _policy(plan, nominal, setting.feedback), play)


def _seen(trajectory: Trajectory, t: Array, sensor: PoseSensor) -> Array:
    """What a noise-free localisation reports at ``t``: (n, 3)."""
    pose = trajectory.pose(t - sensor.delay)
    c, s = np.cos(pose[:, 2]), np.sin(pose[:, 2])
    mx, my = sensor.mounting
    return pose + np.stack([c * mx - s * my, s * mx + c * my, np.full(len(t), sensor.bias)], axis=1)


def _ratio(rover: Rover, setting: Setting) -> float:
    runs = []
    for plan in setting.plans:
        trajectory = _drive(rover, setting, plan, (0.0, 0.0))
        runs.append((plan.t, _seen(trajectory, plan.t, rover.sensor), trajectory.command))
    nominal = setting.rover.truth
    return planar_ratio(runs, nominal.wheel_radius, nominal.track_width, setting.sigma)


def _plant_one(setting: Setting, draw: Draw, wanted: float, start: float) -> Planted | None:
    """The effect at the strength that gives the wanted ratio, or None where these runs cannot show it."""
    plant = PLANT[draw.effect]
    if draw.effect == "sensor_outliers":
        strength, ratio = float(np.clip(wanted / 15, 0.15, 1.0)), wanted
    else:
        strength, ratio = tuned(lambda s: _ratio(plant(setting.rover, draw, s)[0], setting), wanted, start)
        if not 2.5 <= ratio <= 18.0:
            return None
    _, parameters = plant(setting.rover, draw, strength)
    return Planted(draw.effect, draw.target, parameters | {"_strength": strength}, ratio)


def _clash(effects: tuple[str, ...]) -> bool:
    """Whether some data could not tell the members apart, or one undoes another."""
    sizes = {"wheel_radius", "wheel_radius_mismatch", "actuator_gain", "voltage_sag"}
    delays = {"command_delay", "sensor_delay", "actuator_lag"}
    drifts = {"lateral_slip", "sensor_mounting", "sensor_bias"}
    return any(len(group & set(effects)) > 1 for group in (sizes, delays, drifts))


def _choose(level: Level, rng: np.random.Generator) -> tuple[str, ...]:
    names = sorted(PLANT)
    if level.confounded:
        return (
            str(
                rng.choice(
                    [
                        "wheel_radius",
                        "command_delay",
                        "sensor_delay",
                        "wheel_radius_mismatch",
                        "actuator_gain",
                        "slope",
                        "longitudinal_slip",
                    ]
                )
            ),
        )
    while True:
        count = int(rng.integers(level.effects[0], level.effects[1] + 1))
        chosen = tuple(str(n) for n in rng.choice(names, count, replace=False))
        if not _clash(chosen):
            return chosen


class WheeledFamily:
    """Differential drives of many sizes."""

    name = "wheeled"

    def write_case(self, level: Level, seed: int, rng: np.random.Generator, folder: Path) -> Answer:
        """Draw a truth and write what its user would have."""
        for _ in range(_ATTEMPTS):
            answer = self._attempt(level, seed, rng, folder)
            if answer is not None:
                return answer
        raise RuntimeError(f"no wheeled case of level {level.name} with seed {seed} in {_ATTEMPTS} draws")

    def _attempt(self, level: Level, seed: int, rng: np.random.Generator, folder: Path) -> Answer | None:
        effects = _choose(level, rng)
        straight = level.confounded and effects[0] in ("slope", "longitudinal_slip")
        if straight and effects[0] == "longitudinal_slip":
            effects = ("slope",)  # a constant speed never slips: the group stands for it
        setting = _setting(level, effects, straight, rng)
        if level.confounded:
            setting = replace(setting, encoders=False)
        traits = (
            "wheeled",
            "encoders" if setting.encoders else "no_encoders",
            *(("straight",) if straight else ()),
        )
        if level.withheld and not may_be_withheld(effects[0], traits):
            return None
        planted = []
        for effect in effects:
            draw = draw_effect(effect, setting.encoders, rng)
            if straight:
                draw = replace(draw, angle=float(rng.choice([0.0, np.pi])))
            wanted = float(np.exp(rng.uniform(np.log(3.5), np.log(13))))
            one = _plant_one(setting, draw, wanted, float(rng.uniform(0.15, 0.5)))
            if one is None:
                return None
            planted.append((draw, one))
        rover = setting.rover
        background = []
        if level.background:
            for effect in sorted(set(PLANT) - set(effects) - {"saturation", "sensor_outliers"}):
                draw = draw_effect(effect, setting.encoders, rng)
                tried = 0.2 * TYPICAL[effect]
                shown_by_it = max(_ratio(PLANT[effect](setting.rover, draw, tried)[0], setting), 0.2)
                strength = min(
                    tried * level.background * STRONG * float(rng.uniform(0.5, 1.5)) / shown_by_it, 1.0
                )
                rover, parameters = PLANT[effect](rover, draw, strength)
                background.append(Planted(effect, draw.target, parameters))
        rover = _with(rover, planted)
        unknown: tuple[str, ...] = ()
        if level.unknown:
            unknown = (str(rng.choice(UNKNOWN)),)
            found = _unknown(unknown[0], setting, rng)
            if found is None:
                return None
            rover = found
        _write_robot(setting, bool(rng.random() < 0.5), folder)
        _write_runs(rover, setting, rng, folder)
        if planted:
            _write_clean(rover, setting, rng, folder.parent / "clean")
        shown = tuple(
            Planted(p.effect, p.target, {k: v for k, v in p.parameters.items() if k != "_strength"}, p.ratio)
            for _, p in planted
        )
        return Answer(
            case=f"wheeled-{level.name}-{seed}",
            family=self.name,
            level=level.name,
            seed=seed,
            effects=shown,
            background=tuple(background),
            unknown=unknown,
            withheld=effects if level.withheld else (),
            twins=tuple(twins_of(p.effect, traits) for p in shown),
            traits=traits,
            notes={"ratio": _ratio(rover, setting)},
        )


def _with(rover: Rover, planted: list[tuple[Draw, Planted]]) -> Rover:
    for draw, one in planted:
        rover, _ = PLANT[draw.effect](rover, draw, one.parameters["_strength"])
    return rover


def _unknown(cause: str, setting: Setting, rng: np.random.Generator) -> Rover | None:
    """The rover with a cause that no library names, as strong as a strong effect."""
    wanted = float(np.exp(rng.uniform(np.log(4), np.log(12))))
    left = float(rng.uniform(0.6, 1.0))
    blows = []
    for begin in np.arange(1.5, 24.0, 1.7):
        blow = rng.normal(size=3)
        begin = float(begin + rng.uniform(0, 0.8))
        blows.append((begin, begin + float(rng.uniform(0.3, 0.9)), *(float(b) for b in blow)))

    def planted(s: float) -> Rover:
        truth = setting.rover.truth
        if cause == "eccentric_wheel":
            truth = replace(truth, eccentric=(0.5 * s, 0.5 * s * left))
        elif cause == "one_sided_turning":
            truth = replace(truth, one_sided=0.6 * s)
        elif cause == "warming_up":
            truth = replace(truth, warm_up=0.6 * s, warm_up_time=5.0)
        else:
            truth = replace(
                truth, gusts=tuple((a, b, 0.4 * s * x, 0.4 * s * y, 0.8 * s * w) for a, b, x, y, w in blows)
            )
        return replace(setting.rover, truth=truth)

    strength, ratio = tuned(lambda s: _ratio(planted(s), setting), wanted)
    return planted(strength) if 2.5 <= ratio <= 18 else None


def _write_robot(setting: Setting, noise: bool, folder: Path) -> None:
    """The robot file; with the sensors' noise where ``noise`` says so."""
    truth = setting.rover.truth
    lines = [
        'name = "rover"',
        'plant = "diff_drive"',
        "[parameters]",
        f"wheel_radius = {truth.wheel_radius!r}",
        f"track_width = {truth.track_width!r}",
    ]
    if noise:
        xy, th = setting.sigma
        lines += ["[noise]", f'"pose.x" = {xy:.3g}', f'"pose.y" = {xy:.3g}', f'"pose.theta" = {th:.3g}']
    (folder / "robot.toml").write_text("\n".join(lines) + "\n")


def _write_clean(rover: Rover, setting: Setting, rng: np.random.Generator, folder: Path) -> None:
    """The same runs without noise and outliers: what the planted effects' best fit is measured on."""
    folder.mkdir(exist_ok=True)
    _write_robot(setting, True, folder)
    silent = replace(setting, sigma=(0.0, 0.0), encoder_sigma=0.0, rough=Roughness())
    _write_runs(replace(rover, sensor=replace(rover.sensor, outliers=0.0)), silent, rng, folder)


def _write_runs(rover: Rover, setting: Setting, rng: np.random.Generator, folder: Path) -> None:
    """The runs, noise and all."""
    import pandas as pd

    rough = setting.rough
    for plan in setting.plans:
        play = (float(rng.uniform(-0.5, 0.5)), float(rng.uniform(-0.5, 0.5)))
        trajectory = _drive(rover, setting, plan, play)
        pose = _seen(trajectory, plan.t, rover.sensor)
        channels = {
            name: noisy(pose[:, i], setting.sigma[min(i // 2, 1)], rough, rng)
            for i, name in enumerate(("pose.x", "pose.y", "pose.theta"))
        }
        away = outlier_mask(len(plan.t), rover.sensor.outliers, rng)
        for i, name in enumerate(channels):
            size = (
                setting.sigma[min(i // 2, 1)]
                * rng.uniform(15, 60, len(plan.t))
                * rng.choice([-1, 1], len(plan.t))
            )
            channels[name] = channels[name] + np.where(away, size, 0.0)
        with_dropouts(channels, plan.t, rough.dropouts, rng)
        table = {
            "t": plan.t,
            "command.left": trajectory.command[:, 0],
            "command.right": trajectory.command[:, 1],
        }
        table |= channels
        if setting.encoders:
            at = np.searchsorted(trajectory.t, plan.t - 1e-9)
            for i, name in enumerate(("velocity.left", "velocity.right")):
                speed = trajectory.wheel[at, i] + setting.encoder_sigma * rng.standard_normal(len(plan.t))
                table[name] = quantised(speed, 0.5 * setting.encoder_sigma)
        frame = pd.DataFrame(table)
        if setting.table == "csv":
            frame.to_csv(folder / f"{plan.name}.csv", index=False, float_format="%.9g")
        else:
            frame.to_parquet(folder / f"{plan.name}.parquet", index=False)


FAMILY = WheeledFamily()
