"""A run that fits far worse than all others is pointed out, and none where runs differ by chance."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from oracles.rover_log import ROBOT, rover_run, write_run

import residual_mpc as rm
from residual_mpc.diagnosis.results.odd_run import OddRun, odd_run
from residual_mpc.report.terminal import diagnosis_lines

RUN = np.repeat(np.arange(4), 15)


def squares(seed: int, *sizes: float) -> np.ndarray:
    """(60,) squared gaps of windows of four runs."""
    rng = np.random.default_rng(seed)
    return np.asarray(np.array(sizes)[RUN] ** 2 * rng.chisquare(5.0, 60) / 5.0)


def test_a_run_far_worse_than_every_other_is_odd() -> None:
    found = odd_run(squares(0, 0.03, 0.03, 0.09, 0.03), RUN)
    assert isinstance(found, OddRun) and found.run == 2
    assert 0.08 < found.gap < 0.10 and found.others < 0.04


def test_runs_that_differ_by_chance_or_two_that_are_worse_are_not() -> None:
    assert [odd_run(squares(seed, 0.03, 0.03, 0.03, 0.03), RUN) for seed in range(50)] == [None] * 50
    assert odd_run(squares(0, 0.03, 0.09, 0.09, 0.03), RUN) is None
    assert odd_run(squares(0, 0.03, 0.03, 0.05, 0.03), RUN) is None


def test_one_window_makes_no_run_odd() -> None:
    outlier = np.where(np.arange(60) == 40, 1.0, squares(0, 0.03, 0.03, 0.03, 0.03))
    assert odd_run(outlier, RUN) is None


def test_of_two_runs_none_is_odd() -> None:
    assert odd_run(squares(0, 0.03, 0.2, 0.03, 0.03)[:30], RUN[:30]) is None


def test_a_diagnosis_names_it(tmp_path: Path) -> None:
    (tmp_path / "robot.toml").write_text(ROBOT)
    for k in range(3):
        effects = {"actuator_gain": {"gain": 0.75}} if k == 2 else {}
        write_run(rover_run(f"run{k}", effects, 12.0, seed=k), tmp_path)
    robot = rm.load_robot(tmp_path / "robot.toml")
    runs = rm.read_runs(robot, sorted(tmp_path.glob("run*.csv")))
    found = rm.diagnose(robot, runs, only=("sensor_mounting",)).document  # which explains none of it
    assert found["verdict"] == "unknown"
    odd = found["odd_run"]
    assert odd["run"] == "run2" and odd["gap"] > 2.0 * odd["others"]
    assert odd["note"].startswith("run2 fits far worse than every other run") and odd["note"] in found["notes"]
    assert any(odd["run"] in line for line in diagnosis_lines(found))


def test_an_odd_run_does_not_make_the_cause_of_all_others_doubtful(tmp_path: Path) -> None:
    """Left and right are exchanged in one run of five, and the track is wider in all."""
    (tmp_path / "robot.toml").write_text(ROBOT)
    for k in range(5):
        run = rover_run(f"run{k}", {"track_width": {"scale": 1.2}}, 16.0, seed=k)
        if k == 3:
            left, right = run.columns["command.left"], run.columns["command.right"]
            run = replace(run, columns={**run.columns, "command.left": right, "command.right": left})
        write_run(run, tmp_path)
    robot = rm.load_robot(tmp_path / "robot.toml")
    found = rm.diagnose(robot, rm.read_runs(robot, sorted(tmp_path.glob("run*.csv")))).document
    assert found["verdict"] == "partial" and found["odd_run"]["run"] == "run3"
    (cause,) = (e for e in found["explanation"] if e["effect"] == "track_width")
    assert cause["probability"] > 0.8
    low, high = cause["parameters"]["scale"]["ci95"]
    assert low < 1.2 < high
