"""A rover's case as its user would have it: robot file and runs; and the runs without noise."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from plants.blind_families.sensing import Roughness, jumps, noisy, outlier_mask, quantised, with_dropouts, write_table
from plants.blind_families.wheeled_effects import Rover
from plants.blind_families.wheeled_setting import Setting, drive, seen


def write_robot(setting: Setting, noise: bool, folder: Path) -> None:
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


def write_clean(rover: Rover, setting: Setting, rng: np.random.Generator, folder: Path) -> None:
    """The same runs without noise and outliers: what the planted effects' best fit is measured on."""
    folder.mkdir(exist_ok=True)
    write_robot(setting, True, folder)
    silent = replace(setting, sigma=(0.0, 0.0), encoder_sigma=0.0, rough=Roughness())
    write_runs(replace(rover, sensor=replace(rover.sensor, outliers=0.0)), silent, rng, folder)


def write_runs(rover: Rover, setting: Setting, rng: np.random.Generator, folder: Path) -> None:
    """The runs, noise and all."""
    rough = setting.rough
    for plan in setting.plans:
        play = (float(rng.uniform(-0.5, 0.5)), float(rng.uniform(-0.5, 0.5)))
        trajectory = drive(rover, setting, plan, play)
        pose = seen(trajectory, plan.t, rover.sensor)
        channels = {
            name: noisy(pose[:, i], setting.sigma[min(i // 2, 1)], rough, rng)
            for i, name in enumerate(("pose.x", "pose.y", "pose.theta"))
        }
        away = outlier_mask(len(plan.t), rover.sensor.outliers, rng)
        for i, name in enumerate(channels):
            size = jumps(setting.sigma[min(i // 2, 1)], 15, 60, len(plan.t), rng)
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
        write_table(table, plan.name, setting.table, folder)
