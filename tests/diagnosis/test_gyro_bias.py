"""A gyroscope that reads a constant too much, on a robot that measures nothing else."""

from __future__ import annotations

import numpy as np
import pytest
from oracles.rover_log import rover_run

from plants.diff_drive import DiffDrive
from residual_mpc.diagnosis.diagnose import diagnose
from residual_mpc.diagnosis.options import Options
from residual_mpc.logs.run import Run

SIGMA, BIAS = 0.01, 0.05  # rad/s
FEW = ("sensor_bias", "sensor_scale", "track_width", "wheel_radius_mismatch", "actuator_gain", "turn_gain", "slope")


def gyro_run(name: str, bias: float, seed: int) -> Run:
    """The yaw rate of a rover alone, at 50 Hz."""
    run = rover_run(name, {}, 20.0, 50.0, seed=seed, noise=0.0)
    rate = np.gradient(run.columns["pose.theta"], run.t) + bias
    noise = SIGMA * np.random.default_rng([seed, 1]).standard_normal(len(run.t))
    return Run(
        name, run.t, {c: run.columns[c] for c in ("command.left", "command.right")} | {"twist.theta": rate + noise}
    )


@pytest.mark.parametrize(("bias", "only"), [
    (BIAS, FEW),
    pytest.param(BIAS, (), marks=pytest.mark.slow),
    pytest.param(0.0, (), marks=pytest.mark.slow),
])  # fmt: skip
def test_the_bias_of_a_gyroscope_is_named(bias: float, only: tuple[str, ...]) -> None:
    runs = [gyro_run(f"r{k}", bias, seed=k) for k in range(4)]
    robot = DiffDrive("rover", 0.033, 0.16)
    found = diagnose(runs, [robot] * 4, {}, (), Options(only=only), np.random.default_rng(0)).diagnosis
    if not bias:
        assert found.verdict == "no_gap"
        return
    (cause,) = found.causes
    assert (cause.term.effect, cause.term.target) == ("sensor_bias", "twist.theta")
    assert found.verdict == "effects"
    (number,) = cause.parameters
    assert number.ci95[0] <= BIAS <= number.ci95[1]
