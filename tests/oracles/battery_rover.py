"""Logs of a rover whose wheels slow down as its battery empties, with the battery's voltage in a column."""

from __future__ import annotations

import math

import numpy as np

from residual_mpc.logs.run import Run

RADIUS, TRACK = 0.05, 0.3  # m
FILE = f'name = "rover"\nplant = "diff_drive"\n[parameters]\nwheel_radius = {RADIUS}\ntrack_width = {TRACK}\n'
STEP, PERIOD, COMMANDED = 0.002, 0.05, 0.7  # s
SIGMA = {"pose.x": 0.003, "pose.y": 0.003, "pose.theta": 0.004}


def share_at(voltage: float) -> float:
    """What the wheels turn of their command."""
    return 0.55 + 0.45 * math.tanh((voltage - 9.5) / 2.2)


def battery_run(seed: int, full: float, seconds: float = 24.0, weakens: bool = True, right: float = 1.0) -> Run:
    """Explicit Euler steps of wheels 20 ms behind their commands; the voltmeter has noise and falls with the load.
    right: by how much the robot turns to the right of what its wheels say."""
    rng = np.random.default_rng(seed)
    n, every, hold = round(seconds / PERIOD), round(PERIOD / STEP), round(COMMANDED / STEP)
    rows = np.empty((n, 6))
    left = right_wheel = x = y = theta = 0.0
    voltage = full
    for k in range(n * every):
        if k % hold == 0:
            sent_left, sent_right = rng.uniform(-2.0, 9.0, 2).tolist()
        load = 0.5 * (abs(left) + abs(right_wheel))
        if k % every == 0:
            seen = np.array([x, y, theta]) + rng.standard_normal(3) * list(SIGMA.values())
            rows[k // every] = (sent_left, sent_right, *seen, voltage + 0.05 * rng.standard_normal() - 0.004 * load)
        voltage -= STEP * 0.012 * (1.0 + load / 6.0)
        share = share_at(voltage) if weakens else 0.9
        left += STEP / 0.02 * (share * sent_left - left)
        right_wheel += STEP / 0.02 * (share * sent_right - right_wheel)
        forward, yaw = RADIUS * 0.5 * (left + right_wheel), RADIUS * (right_wheel - left) / TRACK
        x += STEP * forward * math.cos(theta)
        y += STEP * forward * math.sin(theta)
        theta += STEP * yaw * (right if yaw < 0.0 else 1.0)
    names = ("command.left", "command.right", *SIGMA)
    columns = {name: rows[:, i] for i, name in enumerate(names)}
    other = {"battery_voltage": rows[:, 5], "row": np.arange(float(n)), "wheel_power": np.abs(rows[:, :2]).sum(axis=1)}
    return Run(f"run{seed}", PERIOD * np.arange(n), columns, extra=tuple(other), extra_columns=other)
