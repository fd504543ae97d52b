"""An arm's case as its user would have it: robot file, model and runs; and the runs without noise."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from plants.blind_families.arm_effects import ArmRobot
from plants.blind_families.arm_runs import Happened
from plants.blind_families.arm_setting import Setting
from plants.blind_families.sensing import Roughness, jumps, noisy, outlier_mask, quantised, with_dropouts, write_table


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
            size = jumps(setting.sigma[j], 20, 120, len(t), rng)
            channels[f"position.{joint}"] = quantised(values + np.where(away, size, 0.0), setting.resolution)
        with_dropouts(channels, t, rough.dropouts, rng)
        table |= channels
        if setting.velocities:
            for j, joint in enumerate(arm.joints):
                table[f"velocity.{joint}"] = speed[r, :, j] + setting.speed_sigma * rng.standard_normal(len(t))
        if setting.drops and not course.on[r].all():
            for j, joint in enumerate(arm.joints):
                table[f"enabled.{joint}"] = course.on[r, :, j].astype(int)
        write_table(table, f"run{r + 1}", setting.table, folder)
