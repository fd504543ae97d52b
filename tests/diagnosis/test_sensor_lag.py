"""A localisation that follows slowly, on rovers of another simulation and through a filter of another form."""

from __future__ import annotations

import numpy as np
import pytest
from oracles.rover_log import rover_run

from plants.diff_drive import DiffDrive
from residual_mpc.diagnosis.diagnose import diagnose
from residual_mpc.diagnosis.options import Options
from residual_mpc.logs.run import Run

ROBOT = DiffDrive("rover", 0.033, 0.16)
LAG, STEP = 0.15, 1e-3  # s, s
SIGMA = {"pose.x": 0.001, "pose.y": 0.001, "pose.theta": 0.002}  # m, m, rad


def slow_run(seed: int, lag: float, noise: float = 1.0) -> Run:
    """20 s at 50 Hz with encoders; the pose is an exponentially weighted mean of past poses, time constant lag. noise:
    of the pose, in units of SIGMA."""
    rng = np.random.default_rng([seed, 6])
    run = rover_run(f"r{seed}", {}, 20.0, 50.0, seed=seed, noise=0.0)
    columns = dict(run.columns)
    for wheel in ("left", "right"):  # read before the command of the stamp acts
        u = columns[f"command.{wheel}"]
        columns[f"velocity.{wheel}"] = np.concatenate([u[:1], u[:-1]]) + 0.01 * rng.standard_normal(len(u))
    age = STEP * (np.arange(int(8 * LAG / STEP)) + 0.5)
    weight = np.exp(-age / lag) / np.exp(-age / lag).sum() if lag else np.zeros(0)
    for c, sigma in SIGMA.items():
        if lag:
            columns[c] = np.interp(run.t[:, None] - age, run.t, run.columns[c]) @ weight
        columns[c] = columns[c] + noise * sigma * rng.standard_normal(len(run.t))
    return Run(run.name, run.t, columns)


@pytest.mark.slow
def test_the_time_constant_is_recovered() -> None:
    runs = [slow_run(k, LAG) for k in range(4)]
    found = diagnose(runs, [ROBOT] * 4, {}, (), Options(), np.random.default_rng(0)).diagnosis
    (cause,) = found.causes
    assert (cause.term.effect, cause.term.target, found.verdict) == ("sensor_lag", "pose", "effects")
    (number,) = cause.parameters
    assert number.ci95[0] <= LAG <= number.ci95[1] and number.value < 1.1 * LAG


@pytest.mark.slow
def test_a_localisation_that_follows_at_once_has_none() -> None:
    runs = [slow_run(k, 0.0) for k in range(4)]
    assert diagnose(runs, [ROBOT] * 4, {}, (), Options(), np.random.default_rng(0)).diagnosis.verdict == "no_gap"


@pytest.mark.slow
def test_without_encoders_a_lag_of_the_motors_is_not_told_from_it() -> None:
    """The slow pose leaves a larger gap than the slow motors, since its input at the start of a window is reconstructed
    from noisy readings: a lag of the motors was 0.67, in no group."""
    runs = [slow_run(k, LAG, 3.0) for k in (3, 4, 5)]
    blind = [Run(r.name, r.t, {k: v for k, v in r.columns.items() if not k.startswith("velocity")}) for r in runs]
    found = diagnose(blind, [ROBOT] * 3, {}, (), Options(), np.random.default_rng(0)).diagnosis
    assert all(c.probability < 0.5 for c in found.causes)
    groups = [{t.effect for member in group for t in member} for group in found.groups]
    assert any({"actuator_lag", "sensor_lag"} <= group for group in groups)
