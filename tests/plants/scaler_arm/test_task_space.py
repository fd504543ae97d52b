"""Runs as samples of fk_prop, and the command that records them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from plants.scaler_arm.engines.mujoco_arm import MujocoArm
from plants.scaler_arm.kinematics.geometry import MOTORS
from plants.scaler_arm.kinematics.loop_closure import at_posture
from plants.scaler_arm.motions import CircleWithHeight, references
from plants.scaler_arm.record import main
from plants.scaler_arm.task_space import COMMAND, POSITION, task_samples
from plants.simulator import Recording, record, replaying
from residual_mpc.errors import BadInput


def test_what_is_left_of_a_run() -> None:
    """From measured joints next to nothing is left; from commanded ones the servo's lag of 0.1 s is."""
    q = references(CircleWithHeight(), np.arange(0.0, 8.01, 0.01))
    run = record(MujocoArm(), replaying(q, 0.01), Recording(8.0, 0.01, at_posture(q[0])), np.random.default_rng(0))
    t = run["t"].to_numpy()
    columns = {c: run[c].to_numpy() for c in run}
    by_joints, by_commands = task_samples(columns, t, POSITION), task_samples(columns, t, COMMAND)
    speed = float(np.linalg.norm(by_joints.came, axis=1)[200:].mean())
    assert by_joints.rates.shape == (800, 6) and by_joints.predicted.shape == (800, 3)
    assert by_joints.h2_norm[200:].mean() < 0.02 * speed
    assert 0.05 * speed < by_commands.h2_norm[200:].mean() < 0.3 * speed
    # the lag it is: shifted by it, the prediction comes true
    late = 10
    off = by_commands.came[200 + late :] - by_commands.predicted[200:-late]
    assert np.linalg.norm(off, axis=1).mean() < 0.25 * by_commands.h2_norm[200:].mean()


def test_what_cannot_be_used_is_named() -> None:
    columns = {f"{k}.{m}": np.zeros(3) for k in ("position", "velocity", "command") for m in MOTORS}
    with pytest.raises(BadInput, match="not evenly spaced"):
        task_samples(columns, np.array([0.0, 0.01, 0.03]), POSITION)
    with pytest.raises(BadInput, match="got 'effort'"):
        task_samples(columns, np.array([0.0, 0.01, 0.02]), "effort")
    del columns["position.f"]
    with pytest.raises(BadInput, match="column position.f is missing"):
        task_samples(columns, np.array([0.0, 0.01, 0.02]), POSITION)


def test_runs_are_recorded_and_the_truth_lies_apart(tmp_path: Path) -> None:
    out, apart = tmp_path / "runs" / "run.csv", tmp_path / "truths" / "truth.json"
    asked = [str(out), "--engine", "mujoco", "--seconds", "1", "--twin", "--draw", "--truth", str(apart)]
    done = CliRunner().invoke(main, asked)
    assert done.exit_code == 0, done.output
    run = pd.read_csv(out)
    assert len(run) == 101 and {f"command.{m}" for m in MOTORS} <= set(run)
    told = json.loads(apart.read_text())
    assert {e["effect"] for e in told["effects"]} == {
        "command_delay", "payload", "actuator_gain", "viscous_friction",
    }  # fmt: skip
    beside = CliRunner().invoke(main, [*asked[:-1], str(out.parent / "truth.json")])
    assert beside.exit_code == 2 and "must not be in the folder" in beside.output
    again = tmp_path / "again.csv"
    CliRunner().invoke(main, [str(again), *asked[1:]])
    assert again.read_bytes() == out.read_bytes()


def test_a_run_of_one_row_is_refused_and_leaves_nothing(tmp_path: Path) -> None:
    done = CliRunner().invoke(main, [str(tmp_path / "run.csv"), "--seconds", "0.1", "--period", "1"])
    assert done.exit_code == 2 and "at least two rows" in done.output
    assert not list(tmp_path.iterdir())
