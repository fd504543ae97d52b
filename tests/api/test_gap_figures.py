"""The gap over several horizons, and on the data that a diagnosis held out."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from oracles.rover_log import SIGMA, rover_run

from plants.diff_drive import DiffDrive
from residual_mpc.api.gap_figures import gap_figures
from residual_mpc.diagnosis.data.dataset import build_dataset
from residual_mpc.logs.run import Run
from residual_mpc.models.model_file import read_written
from residual_mpc.models.robot_file import RobotFile

ROVER = DiffDrive("rover", 0.033, 0.16)
FILE = RobotFile("rover", "diff_drive", noise=SIGMA)


def runs_of(ratio: float) -> list[Run]:
    return [rover_run(f"r{k}", {"wheel_radius_mismatch": {"ratio": ratio}}, 31.0, seed=k) for k in range(3)]


def test_the_headline_is_the_first_of_the_horizons() -> None:
    gap = gap_figures(runs_of(1.06), [ROVER] * 3, FILE, 1.0, None, None, 0)
    assert [h["horizon"] for h in gap["horizons"]] == [1.0, 5.0, 30.0]
    first = gap["horizons"][0]
    assert first["nominal"] == gap["nominal"] and first["noise_floor"] == gap["noise_floor"]
    assert gap["windows"] == 93 and gap["horizons"][1]["windows"] == 18
    spread = gap["window_gaps"]["nominal"]
    assert 0.0 < spread["p50"] <= spread["p90"] <= spread["max"]
    one = [r for r in runs_of(1.06) if r.name == spread["run"]]
    alone = gap_figures(one, [ROVER], FILE, 1.0, None, None, 0)["window_gaps"]["nominal"]
    assert spread["from"] == pytest.approx(round(spread["from"])) == alone["from"]
    assert gap["constant_velocity"] > 5.0 * gap["nominal"]


def test_what_was_kept_back_is_measured_over_every_horizon(tmp_path: Path) -> None:
    """The same holds if only the held-out runs are given."""
    kept = tmp_path / "diagnosis.json"
    kept.write_text(json.dumps({"held_out": ["r2"]}))
    runs = runs_of(1.06)
    among = gap_figures(runs, [ROVER] * 3, FILE, 1.0, None, read_written(kept), 0)
    assert [h["windows"] for h in among["horizons"]] == [31, 6, 1]
    alone = gap_figures(runs[2:], [ROVER], FILE, 1.0, None, read_written(kept), 0)
    assert [h["windows"] for h in alone["horizons"]] == [31, 6]  # one window of 30 s is too few


def test_the_warm_up_of_a_wheel_begins_at_its_measured_speed() -> None:
    """Else a lag of a second would still hold the warm-up's first command (finding 9 of the outside checks)."""
    t = np.arange(0.0, 8.0, 0.05)
    u = np.where(t < 3.0, 0.0, 5.0)
    speed = np.where(t < 3.0, 0.0, 5.0 * (1.0 - np.exp(-(t - 3.0) / 1.0)))
    pose = {c: np.zeros(len(t)) for c in ("pose.y", "pose.theta")}
    columns = {"command.left": u, "command.right": u, "pose.x": 0.033 * np.cumsum(speed) * 0.05, **pose}
    bare = build_dataset([Run("r", t, columns)], [ROVER], SIGMA).blocks[0].drive
    wheels = {**columns, "velocity.left": speed, "velocity.right": speed}
    logged = build_dataset([Run("r", t, wheels)], [ROVER], SIGMA).blocks[0].drive
    start = 6.0 - bare.lead * bare.dt  # s: where the warm-up of the window at 6 s begins
    assert bare.command[6, 0, 0] == pytest.approx(5.0)
    assert logged.command[6, 0, 0] == pytest.approx(5.0 * (1.0 - np.exp(-(start - 3.0))), rel=0.02)
    np.testing.assert_array_equal(bare.command[6, 1:], logged.command[6, 1:])
