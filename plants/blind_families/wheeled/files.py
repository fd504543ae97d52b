"""A rover's case as its user would have it: robot file and runs; and the runs without noise."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

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
from plants.blind_families.wheeled.effects import SIDES, Rover
from plants.blind_families.wheeled.setting import Setting, drive, seen
from plants.blind_families.wheeled.truth import Trajectory
from residual_mpc.blind.commanded_motion import CommandedMotion

ENCODERS = ("velocity.left", "velocity.right")


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
    for number, plan in enumerate(setting.plans):
        trajectory = drive(rover, setting, plan, _play(rng))
        began, _ = rover.at(plan.name)
        table = _logged(began, setting, trajectory, plan.t, rng)
        table["t"] = stamped(plan.t, number, setting.rough, rng)
        write_table(table, plan.name, setting.table, folder)


def write_played(
    rover: Rover, setting: Setting, motion: CommandedMotion, rng: np.random.Generator, name: str, folder: Path
) -> None:
    """One run under commands of somebody else's; encoders are logged as well where they are asked for."""
    if rover.changes:  # what became of it in the last run that changed
        rover = rover.changes[max(rover.changes)][1]
    t, u = jittered(motion.t, setting.rough, rng), motion.table(SIDES)
    trajectory = setting.simulate(rover.truth, t, lambda k, x, y, theta: (float(u[k, 0]), float(u[k, 1])), _play(rng))
    encoders = setting.encoders or any(c in ENCODERS for c in motion.sensors)
    write_table(_logged(rover, replace(setting, encoders=encoders), trajectory, t, rng), name, setting.table, folder)


def _play(rng: np.random.Generator) -> tuple[float, float]:
    """Where each gear stands in its backlash when a run begins."""
    return float(rng.uniform(-0.5, 0.5)), float(rng.uniform(-0.5, 0.5))


def _logged(
    rover: Rover, setting: Setting, trajectory: Trajectory, t: Array, rng: np.random.Generator
) -> dict[str, Array]:
    """The table of one run: what the sensors report at ``t`` (n,), noise and all."""
    rough = setting.rough
    pose = seen(trajectory, t, rover.sensor)
    channels = {
        name: noisy(pose[:, i], setting.sigma[min(i // 2, 1)], rough, rng)
        for i, name in enumerate(("pose.x", "pose.y", "pose.theta"))
    }
    away = outlier_mask(len(t), rover.sensor.outliers, rng)
    for i, name in enumerate(channels):
        size = jumps(setting.sigma[min(i // 2, 1)], 15, 60, len(t), rng)
        channels[name] = channels[name] + np.where(away, size, 0.0)
    with_dropouts(channels, t, rough.dropouts, rng)
    if rough.lost:
        gone = outlier_mask(len(t), rough.lost, rng)
        channels = {name: np.where(gone, np.nan, values) for name, values in channels.items()}
    table = {"t": t, "command.left": trajectory.command[:, 0], "command.right": trajectory.command[:, 1]}
    table |= channels
    if setting.encoders:
        at = np.searchsorted(trajectory.t, t - 1e-9)
        for i, name in enumerate(ENCODERS):
            speed = trajectory.motor[at, i] + setting.encoder_sigma * rng.standard_normal(len(t))
            table[name] = quantised(speed, 0.5 * setting.encoder_sigma)
    return table
