"""Logs of the literal rover: noise on its pose, commands held between the stamps."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from oracles.rover_euler import simulate

from residual_mpc.logs.run import Run

SIGMA = {"pose.x": 0.001, "pose.y": 0.001, "pose.theta": 0.002}  # m, m, rad
ROBOT = 'name = "rover"\nplant = "diff_drive"\n[parameters]\nwheel_radius = 0.033\ntrack_width = 0.16\n'


def rover_run(
    name: str,
    faults: Mapping[str, Mapping[str, float]],
    seconds: float = 20.0,
    rate: float = 20.0,
    seed: int = 0,
    noise: float = 1.0,
    jitter: float = 0.0,
) -> Run:
    """A rover driven by sums of sines. noise: in units of SIGMA; jitter: of the stamps, in periods."""
    rng = np.random.default_rng(seed)
    n = int(seconds * rate) + 1
    t = (np.arange(n) + jitter * rng.uniform(-0.5, 0.5, n)) / rate
    t -= t[0]
    frequency, phase = rng.uniform(0.15, 0.7, (3, 2)), rng.uniform(0, 6.28, (3, 2))
    u = (4.0 * np.sin(2 * np.pi * frequency * t[:, None, None] + phase)).sum(axis=1)  # rad/s
    stamps, sent = t.tolist(), [(left, right) for left, right in u.tolist()]
    k = 0

    def command(time: float) -> tuple[float, float]:
        nonlocal k  # time mostly goes forward: start from where it was
        time += 1e-9
        while k + 1 < n and stamps[k + 1] <= time:
            k += 1
        while k > 0 and stamps[k] > time:
            k -= 1
        return sent[k]

    pose = simulate(command, t, faults, fine=5e-4)
    columns = {"command.left": u[:, 0], "command.right": u[:, 1]}
    for i, (channel, sigma) in enumerate(SIGMA.items()):
        columns[channel] = pose[:, i] + noise * sigma * rng.standard_normal(n)
    return Run(name, t, columns)


def write_run(run: Run, folder: Path) -> Path:
    """<name>.csv in the folder; a missing sample is an empty cell."""
    path = folder / f"{run.name}.csv"
    rows = [",".join(["t", *run.columns])]
    for k, t in enumerate(run.t):
        cells = ["" if np.isnan(c[k]) else f"{c[k]:.6f}" for c in run.columns.values()]
        rows.append(",".join([f"{t:.4f}", *cells]))
    path.write_text("\n".join(rows) + "\n")
    return path
