"""A heading that reads a multiple of what the robot turns, on rovers of another simulation."""

from __future__ import annotations

import numpy as np
import pytest
from oracles.rover_log import rover_run

from plants.diff_drive import DiffDrive
from residual_mpc.diagnosis.diagnose import diagnose
from residual_mpc.diagnosis.options import Options
from residual_mpc.logs.run import Run

ROBOT = DiffDrive("rover", 0.033, 0.16)
SIGMA = 0.02  # rad/s, of an encoder
FEW = ("sensor_scale", "sensor_bias", "sensor_delay", "track_width", "wheel_radius", "actuator_gain", "turn_gain")


def scaled_run(name: str, channel: str | None, scale: float, seed: int) -> Run:
    """20 s of a rover's pose and encoders at 30 Hz, one channel scaled and the heading wrapped, as logs have it. The
    rover is integrated by Euler's method, in steps of its own."""
    rng = np.random.default_rng([seed, 5])
    run = rover_run(name, {}, 20.0, 30.0, seed=seed, noise=0.0)
    columns = dict(run.columns)
    for wheel in ("left", "right"):  # read before the command of the stamp acts
        u = columns[f"command.{wheel}"]
        columns[f"velocity.{wheel}"] = np.concatenate([u[:1], u[:-1]])
    if channel is not None:
        first = columns[channel][0] if channel == "pose.theta" else 0.0
        columns[channel] = first + scale * (columns[channel] - first)
    for c, sigma in (("pose.x", 0.002), ("pose.y", 0.002), ("pose.theta", 0.004)):
        columns[c] = columns[c] + sigma * rng.standard_normal(len(run.t))
    columns["pose.theta"] = np.remainder(columns["pose.theta"] + np.pi, 2 * np.pi) - np.pi
    for wheel in ("left", "right"):
        columns[f"velocity.{wheel}"] = columns[f"velocity.{wheel}"] + SIGMA * rng.standard_normal(len(run.t))
    return Run(name, run.t, columns)


@pytest.mark.parametrize(
    ("channel", "scale", "only"),
    [
        ("pose.theta", 1.06, FEW),
        pytest.param(None, 1.0, (), marks=pytest.mark.slow),
        pytest.param("pose.theta", 1.06, (), marks=pytest.mark.slow),
        pytest.param("pose.theta", 0.93, (), marks=pytest.mark.slow),
        pytest.param("velocity.right", 1.1, (), marks=pytest.mark.slow),
    ],
)
def test_the_scale_of_a_heading_is_recovered(channel: str | None, scale: float, only: tuple[str, ...]) -> None:
    """The scale of an encoder beside a pose is no gap: encoders are not compared there."""
    runs = [scaled_run(f"r{k}", channel, scale, seed=k) for k in range(4)]
    found = diagnose(runs, [ROBOT] * 4, {}, (), Options(only=only), np.random.default_rng(0)).diagnosis
    if channel != "pose.theta":
        assert found.verdict == "no_gap"
        return
    (cause,) = found.causes
    assert (cause.term.effect, cause.term.target) == ("sensor_scale", channel)
    (number,) = cause.parameters
    assert number.ci95[0] <= scale <= number.ci95[1]
