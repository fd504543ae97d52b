"""Blind cases of serial arms of 2 to 7 hinges, drawn at random."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from plants.blind_families import arm_motions as motions
from plants.blind_families.arm_effects import (
    PLANT,
    TYPICAL,
    ArmRobot,
    ArmSensor,
    Draw,
    draw_effect,
    target_of,
)
from plants.blind_families.arm_model import Arm, draw_arm, inertia_at, mjcf
from plants.blind_families.arm_runs import Course, Happened, gap_ratio, play
from plants.blind_families.arm_truth import STEP, ArmTruth, ideal, inside
from plants.blind_families.sensing import (
    Roughness,
    draw_roughness,
    noisy,
    outlier_mask,
    quantised,
    stamps,
    with_dropouts,
)
from plants.blind_families.strength import tuned
from residual_mpc.blind.levels import Level
from residual_mpc.blind.records import Answer, Planted
from residual_mpc.blind.twins import may_be_withheld, twins_of

Array = NDArray[np.float64]
UNKNOWN = ("cogging", "dragging_cable", "warming_friction", "gusts")
STRONG = 7.0  # ratio to the noise floor of a usual strong effect
_ATTEMPTS = 60  # draws of effects before a level is given up
_SPEED_NOISE = 0.02  # rad/s, of logged joint speeds
_SPIN_UP = 0.7  # s, reference held at home at the start of a run


@dataclass(frozen=True)
class Setting:
    """Everything of a case that is no effect."""

    robot: ArmRobot  # without any effect
    course: Course
    sigma: Array  # (n,) rad
    resolution: float  # rad, of the encoders
    rough: Roughness
    velocities: bool
    speed_sigma: float  # rad/s
    drops: bool
    table: str  # csv or parquet


def _course(arm: Arm, level: Level, rough: Roughness, drops: bool, rng: np.random.Generator) -> Course:
    rate = float(rng.choice([50.0, 62.5, 100.0, 125.0])) if arm.kind == "position" else 125.0
    seconds = float(rng.uniform(15, 19))
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
    return Course(t, reference, on, 0.8 if level.rough else 0.0)


def _setting(level: Level, rng: np.random.Generator) -> Setting | None:
    arm = draw_arm(rng)
    n = len(arm.axes)
    rough = draw_roughness(rng) if level.rough else Roughness()
    drops = bool(rng.random() < 0.5)
    course = _course(arm, level, replace(rough, resolution=0.0), drops, rng)
    sigma = np.full(n, float(rng.uniform(0.0008, 0.0015))) * level.noise
    nothing = ArmSensor(np.zeros(n), np.zeros(n), np.zeros(n))
    happened = play(ideal(arm), course)
    if happened is None:
        return None
    speed = happened.speed(course.t, nothing)
    scale = np.sqrt((happened.torque**2).mean(axis=(0, 1)))
    robot = ArmRobot(
        ideal(arm),
        nothing,
        np.quantile(np.abs(happened.torque), 0.995, axis=(0, 1)),
        scale,
        np.sqrt((speed**2).mean(axis=(0, 1))),
        inertia_at(arm, arm.home),
        np.abs(happened.command).max(axis=(0, 1)),
    )
    resolution = 2 * np.pi / float(rng.choice([4096, 16384]))
    table = str(rng.choice(["csv", "parquet"]))
    velocities = bool(rng.random() < 0.4)
    return Setting(robot, course, sigma, resolution, rough, velocities, _SPEED_NOISE, drops, table)


def _ratio(robot: ArmRobot, setting: Setting) -> float:
    """What the robot's effects add to the gap, over the noise floor; 0 where the arm cannot have them."""
    if not inside(robot.truth):
        return 0.0
    course = setting.course
    happened = play(robot.truth, course)
    if happened is None:
        return float("inf")
    seen, speed = happened.seen(course.t, robot.sensor), happened.speed(course.t, robot.sensor)
    sigma = np.sqrt(setting.sigma**2 + setting.resolution**2 / 12)
    # the slope of a quadratic through five samples; where speeds are logged, the middle value of one
    period = float(np.median(np.diff(course.t)))
    slope = (
        0.7 * _SPEED_NOISE * np.ones_like(sigma) if setting.velocities else sigma / (period * np.sqrt(10.0))
    )
    return gap_ratio(setting.robot.truth.arm, course, seen, speed, happened.command, sigma, slope)


def _plant_one(setting: Setting, draw: Draw, wanted: float, start: float) -> Planted | None:
    """The effect at the strength that gives the wanted ratio, or None where these runs cannot show it."""
    plant = PLANT[draw.effect]
    if draw.effect == "sensor_outliers":
        strength, ratio = float(np.clip(wanted / 15, 0.15, 1.0)), wanted
    else:
        strength, ratio = tuned(
            lambda s: _ratio(plant(setting.robot, draw, s)[0], setting), wanted, start, tries=5
        )
        if not 2.5 <= ratio <= 18.0:
            return None
    _, parameters = plant(setting.robot, draw, strength)
    return Planted(draw.effect, target_of(draw), parameters | {"_strength": strength}, ratio)


def _clash(effects: tuple[str, ...]) -> bool:
    """Whether data could hardly tell the members apart, or one undoes another."""
    groups = (
        {"command_delay", "sensor_delay", "actuator_lag"},
        {"coulomb_friction", "stribeck_friction", "load_dependent_friction"},
        {"payload", "link_mass", "armature"},
        {"actuator_gain", "voltage_sag", "saturation"},
    )
    return any(len(group & set(effects)) > 1 for group in groups)


def _choose(level: Level, rng: np.random.Generator) -> tuple[str, ...]:
    if level.confounded:
        return (str(rng.choice(["command_delay", "sensor_delay"])),)
    names = sorted(PLANT)
    while True:
        count = int(rng.integers(level.effects[0], level.effects[1] + 1))
        chosen = tuple(str(n) for n in rng.choice(names, count, replace=False))
        if not _clash(chosen):
            return chosen


class ArmFamily:
    """Serial arms with position, velocity or torque actuators."""

    name = "arm"

    def write_case(self, level: Level, seed: int, rng: np.random.Generator, folder: Path) -> Answer:
        """Draw a truth and write what its user would have."""
        for _ in range(_ATTEMPTS):
            answer = self._attempt(level, seed, rng, folder)
            if answer is not None:
                return answer
        raise RuntimeError(f"no arm case of level {level.name} with seed {seed} in {_ATTEMPTS} draws")

    def _attempt(self, level: Level, seed: int, rng: np.random.Generator, folder: Path) -> Answer | None:
        effects = _choose(level, rng)
        setting = _setting(level, rng)
        if setting is None:
            return None
        arm = setting.robot.truth.arm
        if level.confounded and setting.drops:
            return None
        traits = ("arm", "drops" if setting.drops else "no_drops")
        if level.withheld and not may_be_withheld(effects[0], traits):
            return None
        planted = []
        for effect in effects:
            draw = draw_effect(effect, len(arm.axes), rng)
            wanted = float(np.exp(rng.uniform(np.log(3.5), np.log(13))))
            one = _plant_one(setting, draw, wanted, float(rng.uniform(0.1, 0.4)))
            if one is None:
                return None
            planted.append((draw, one))
        robot = setting.robot
        background = []
        if level.background:
            for effect in sorted(
                set(PLANT) - set(effects) - {"saturation", "sensor_outliers", "stribeck_friction"}
            ):
                if _clash((effect, *effects)) and effect in ("coulomb_friction", "load_dependent_friction"):
                    continue
                draw = draw_effect(effect, len(arm.axes), rng)
                tried = 0.2 * TYPICAL[effect]
                shown_by_it = max(_ratio(PLANT[effect](setting.robot, draw, tried)[0], setting), 0.2)
                strength = min(
                    tried * level.background * STRONG * float(rng.uniform(0.5, 1.5)) / shown_by_it, 0.5
                )
                robot, parameters = PLANT[effect](robot, draw, strength)
                background.append(Planted(effect, target_of(draw), parameters))
        robot = _with(robot, planted)
        unknown: tuple[str, ...] = ()
        if level.unknown:
            unknown = (str(rng.choice(UNKNOWN)),)
            found = _unknown(unknown[0], setting, rng)
            if found is None:
                return None
            robot = found
        happened = play(robot.truth, setting.course)
        if happened is None:
            return None
        _write_robot(setting, bool(rng.random() < 0.5), folder)
        _write_runs(robot, happened, setting, rng, folder)
        if planted:
            _write_clean(robot, happened, setting, rng, folder.parent / "clean")
        shown = tuple(
            Planted(p.effect, p.target, {k: v for k, v in p.parameters.items() if k != "_strength"}, p.ratio)
            for _, p in planted
        )
        return Answer(
            case=f"arm-{level.name}-{seed}",
            family=self.name,
            level=level.name,
            seed=seed,
            effects=shown,
            background=tuple(background),
            unknown=unknown,
            withheld=effects if level.withheld else (),
            twins=tuple(twins_of(p.effect, traits) for p in shown),
            traits=traits,
            notes={"ratio": _ratio(robot, setting), "joints": len(arm.axes), "actuators": arm.kind},
        )


def _with(robot: ArmRobot, planted: list[tuple[Draw, Planted]]) -> ArmRobot:
    for draw, one in planted:
        robot, _ = PLANT[draw.effect](robot, draw, one.parameters["_strength"])
    return robot


def _unknown(cause: str, setting: Setting, rng: np.random.Generator) -> ArmRobot | None:
    """The robot with a cause that no library names, as strong as a strong effect."""
    wanted = float(np.exp(rng.uniform(np.log(4), np.log(12))))
    truth, torque = setting.robot.truth, setting.robot.torque_rms
    n = len(torque)
    one = np.zeros(n)
    one[rng.integers(n)] = 1.0
    teeth = int(rng.integers(9, 26))
    blows = []
    for begin in np.arange(1.5, setting.course.t[-1] - 1.0, 1.6):
        begin = float(begin + rng.uniform(0, 0.8))
        blows.append([begin, begin + float(rng.uniform(0.2, 0.7)), *(rng.normal(size=n) * torque)])

    def planted(s: float) -> ArmRobot:
        changed: ArmTruth
        if cause == "cogging":
            changed = replace(truth, cogging=2.0 * s * torque * one, cogging_teeth=teeth)
        elif cause == "dragging_cable":
            changed = replace(truth, cable=6.0 * s * torque * one)
        elif cause == "warming_friction":
            changed = replace(truth, warm_up=3.0 * s * torque * one)
        else:
            gusts = np.array(blows)
            gusts[:, 2:] *= 2.0 * s
            changed = replace(truth, gusts=gusts)
        return replace(setting.robot, truth=changed)

    strength, ratio = tuned(lambda s: _ratio(planted(s), setting), wanted, tries=5)
    return planted(strength) if 2.5 <= ratio <= 18 else None


def _write_robot(setting: Setting, noise: bool, folder: Path) -> None:
    """The robot file and the nominal model; with the sensors' noise where ``noise`` says so."""
    arm = setting.robot.truth.arm
    lines = ['name = "arm"', 'plant = "mujoco"', 'model = "arm.xml"', 'payload_site = "tool"']
    if noise:
        lines.append("[noise]")
        lines += [
            f'"position.{joint}" = {sigma:.3g}'
            for joint, sigma in zip(arm.joints, setting.sigma, strict=True)
        ]
    (folder / "arm.xml").write_text(mjcf(arm))
    (folder / "robot.toml").write_text("\n".join(lines) + "\n")


def _write_clean(
    robot: ArmRobot, happened: Happened, setting: Setting, rng: np.random.Generator, folder: Path
) -> None:
    """The same runs without noise and outliers: what the planted effects' best fit is measured on."""
    folder.mkdir(exist_ok=True)
    _write_robot(setting, True, folder)
    silent = replace(setting, sigma=0.0 * setting.sigma, resolution=0.0, rough=Roughness(), speed_sigma=0.0)
    calm = replace(robot.sensor, outliers=0.0 * robot.sensor.outliers)
    _write_runs(replace(robot, sensor=calm), happened, silent, rng, folder)


def _write_runs(
    robot: ArmRobot, happened: Happened, setting: Setting, rng: np.random.Generator, folder: Path
) -> None:
    """The runs, noise and all."""
    import pandas as pd

    arm, course, rough = setting.robot.truth.arm, setting.course, setting.rough
    t = course.t
    seen, speed = happened.seen(t, robot.sensor), happened.speed(t, robot.sensor)
    for r in range(seen.shape[0]):
        table = {"t": t}
        for j, joint in enumerate(arm.joints):
            table[f"command.{joint}"] = happened.command[r, :, j]
        channels = {}
        for j, joint in enumerate(arm.joints):
            values = noisy(seen[r, :, j], setting.sigma[j], replace(rough, resolution=0.0), rng)
            away = outlier_mask(len(t), float(robot.sensor.outliers[j]), rng)
            size = setting.sigma[j] * rng.uniform(20, 120, len(t)) * rng.choice([-1, 1], len(t))
            channels[f"position.{joint}"] = quantised(values + np.where(away, size, 0.0), setting.resolution)
        with_dropouts(channels, t, rough.dropouts, rng)
        table |= channels
        if setting.velocities:
            for j, joint in enumerate(arm.joints):
                table[f"velocity.{joint}"] = speed[r, :, j] + setting.speed_sigma * rng.standard_normal(
                    len(t)
                )
        if setting.drops and not course.on[r].all():
            for j, joint in enumerate(arm.joints):
                table[f"enabled.{joint}"] = course.on[r, :, j].astype(int)
        frame = pd.DataFrame(table)
        if setting.table == "csv":
            frame.to_csv(folder / f"run{r + 1}.csv", index=False, float_format="%.9g")
        else:
            frame.to_parquet(folder / f"run{r + 1}.parquet", index=False)


FAMILY = ArmFamily()
