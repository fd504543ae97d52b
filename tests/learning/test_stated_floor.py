"""The noise floor that `learn` states is that of `gap` on the same windows, also where the noise is slow."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from oracles.rover_log import ROBOT, rover_run, write_run

import residual_mpc as rm
from residual_mpc.diagnosis.data.noise_model import ornstein_uhlenbeck
from residual_mpc.logs.run import Run

WANDERS = {"pose.x": 0.01, "pose.y": 0.01, "pose.theta": 0.03}  # m, m, rad: 1 sigma
TIME = 0.3  # s: of its correlation


def wandering(run: Run, seed: int) -> Run:
    rng = np.random.default_rng(seed)
    moved = {c: run.columns[c] + s * ornstein_uhlenbeck(run.t, TIME, 1, rng)[0] for c, s in WANDERS.items()}
    return Run(run.name, run.t, {**run.columns, **moved})


@pytest.mark.parametrize("faults", [{}, {"actuator_lag": {"time_constant": 0.3}, "track_width": {"scale": 1.4}}])
def test_the_floor_of_slow_noise_is_that_of_gap(faults: dict[str, dict[str, float]], tmp_path: Path) -> None:
    (tmp_path / "robot.toml").write_text(ROBOT)
    files = [write_run(wandering(rover_run(f"r{k}", faults, 21.0, seed=k), 90 + k), tmp_path) for k in range(5)]
    robot = rm.load_robot(tmp_path / "robot.toml")
    runs = rm.read_runs(robot, files)
    found = rm.learn(robot, runs, passes=1, out=tmp_path / "learned").gap
    model = tmp_path / "learned" / "model.json"
    gap = rm.measure_gap(robot, runs, model=model, held_out_of=model)
    assert gap.document["model"] == pytest.approx(found["after"])
    assert found["noise_floor"] == pytest.approx(gap.noise_floor, rel=0.25)
    assert found["at_noise_floor"]["before"] == (not faults)
