"""An arm's case as its user would have it: robot file, model and runs; and the runs without noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from plants.blind_families.arm.effects import ArmRobot
from plants.blind_families.arm.runs import Happened, replay
from plants.blind_families.arm.setting import Setting
from plants.blind_families.arm.truth import STEP
from plants.blind_families.sensing import (
    Array,
    Roughness,
    jittered,
    jumps,
    noisy,
    outlier_mask,
    quantised,
    stamped,
    with_dropouts,
    write_table,
)
from residual_mpc.blind.commanded_motion import CommandedMotion


def write_robot(setting: Setting, noise: bool, folder: Path) -> None:
    """The robot file and the nominal model; with the sensors' noise where ``noise`` says so."""
    arm = setting.robot.truth.arm
    lines = ['name = "arm"', *arm.write_model(folder)]
    if noise:
        lines.append("[noise]")
        lines += [f'"position.{joint}" = {sigma:.3g}' for joint, sigma in zip(arm.joints, setting.sigma, strict=True)]
    (folder / "robot.toml").write_text("\n".join(lines) + "\n")


def write_clean(robot: ArmRobot, happened: Happened, setting: Setting, rng: np.random.Generator, folder: Path) -> None:
    """The same runs without noise and outliers: what the planted effects' best fit is measured on."""
    folder.mkdir(exist_ok=True)
    write_robot(setting, True, folder)
    silent = replace(setting, sigma=0.0 * setting.sigma, resolution=0.0, rough=Roughness(), speed_sigma=0.0)
    calm = replace(robot.sensor, outliers=0.0 * robot.sensor.outliers)
    write_runs(replace(robot, sensor=calm), happened, silent, rng, folder)


def write_runs(robot: ArmRobot, happened: Happened, setting: Setting, rng: np.random.Generator, folder: Path) -> None:
    """The runs, noise and all."""
    motion = setting.motion
    names = [f"run{r + 1}" for r in range(len(motion.on))]
    _write(robot, happened, setting, motion.t, motion.on, names, rng, folder)


def write_played(
    robot: ArmRobot, setting: Setting, motion: CommandedMotion, rng: np.random.Generator, name: str, folder: Path
) -> bool:
    """One run from rest at home under commands of somebody else's; False where the arm runs away."""
    arm = setting.robot.truth.arm
    t = np.unique(np.round(jittered(motion.t, setting.rough, rng) / STEP)) * STEP
    row = np.clip(np.searchsorted(motion.t, t + 0.5 * (motion.t[1] - motion.t[0])) - 1, 0, len(motion.t) - 1)
    commands, on = motion.table(arm.joints)[None, row], motion.on(arm.joints)[None, row]
    truth = robot.changes[-1][1] if robot.changes else robot.truth  # what became of it in the last run
    happened = replay(truth, t, arm.home[None].copy(), commands, on)
    if happened is None:
        return False
    switched = replace(setting, drops=bool(motion.enabled))
    _write(robot, happened, switched, t, on, [name], rng, folder)
    return True


def _write(
    robot: ArmRobot,
    happened: Happened,
    setting: Setting,
    t: Array,
    on: Array,
    names: Sequence[str],
    rng: np.random.Generator,
    folder: Path,
) -> None:
    """The runs by name that share their stamps ``t`` (k,) s; on: (r, k, n), 1 where the motors are on."""
    arm, rough = setting.robot.truth.arm, setting.rough
    seen, speed = happened.seen(t, robot.sensor), happened.speed(t, robot.sensor)
    for r, name in enumerate(names):
        table = {"t": stamped(t, r, rough, rng)}
        for j, joint in enumerate(arm.joints):
            table[f"command.{joint}"] = happened.command[r, :, j]
        channels = {}
        for j, joint in enumerate(arm.joints):
            values = noisy(seen[r, :, j], setting.sigma[j], replace(rough, resolution=0.0), rng)
            away = outlier_mask(len(t), float(robot.sensor.outliers[j]), rng)
            size = jumps(setting.sigma[j], 20, 120, len(t), rng)
            channels[f"position.{joint}"] = quantised(values + np.where(away, size, 0.0), setting.resolution)
        with_dropouts(channels, t, rough.dropouts, rng)
        if rough.lost:
            gone = outlier_mask(len(t), rough.lost, rng)
            channels = {name: np.where(gone, np.nan, values) for name, values in channels.items()}
        table |= channels
        if setting.velocities:
            for j, joint in enumerate(arm.joints):
                table[f"velocity.{joint}"] = speed[r, :, j] + setting.speed_sigma * rng.standard_normal(len(t))
        if setting.drops and not on[r].all():
            for j, joint in enumerate(arm.joints):
                table[f"enabled.{joint}"] = on[r, :, j].astype(int)
        write_table(table, name, setting.table, folder)
