"""The whole way: runs recorded, then gap and diagnosis through the command line."""

import json
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from plants.simulator import Recording, record, write_run
from plants.wheeled import bullet_drive, mujoco_drive
from plants.wheeled.motions import figure_eight, policy, spin_in_place
from plants.wheeled.record import main as record_runs
from plants.wheeled.simulators import TURTLEBOT
from plants.wheeled.twin import FRAME, Withheld, camera, encoders, noisy, twin
from residual_mpc.cli.main import cli

SMOOTH = (replace(camera(0.0), spike=None, loss=0.0), encoders())


def written(folder, simulator, seconds, period=FRAME):
    for seed, motion in enumerate((spin_in_place(period=5.0), figure_eight(period=8.0))):
        table = record(
            simulator, policy(motion, TURTLEBOT, period), Recording(seconds, period, {}), np.random.default_rng(seed)
        )
        write_run(table, folder / f"{motion.name}.csv")
    return str(folder)


def printed(*arguments):
    result = CliRunner().invoke(cli, [*arguments, "--json"], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


def gap(model, runs):
    return printed("gap", "--robot", model, runs)


def test_the_engines_are_closer_to_each_other_than_the_equation_is_to_either(tmp_path):
    """Without noise and without anything withheld: docs/results/differential-drive.md has the figures."""
    runs = written(tmp_path / "runs", bullet_drive(), 5.0, 0.02)
    across = gap("diff_drive_mujoco", runs)["nominal"]
    equation = gap("diff_drive", runs)["nominal"]
    assert across < 0.004
    assert 2 * across < equation < 0.05


def test_pybullet_as_the_model_of_its_own_run(tmp_path):
    runs = written(tmp_path / "runs", bullet_drive(), 3.0, 0.05)
    assert gap("diff_drive_pybullet", runs)["nominal"] < 0.004


def test_a_twin_leaves_a_gap_that_its_simulator_does_not(tmp_path):
    plain = gap("diff_drive", written(tmp_path / "plain", noisy(bullet_drive()), 5.0))
    real = gap("diff_drive", written(tmp_path / "real", twin(bullet_drive(), Withheld(track=1.1), SMOOTH), 5.0))
    assert plain["nominal"] < 1.5 * plain["noise_floor"]  # the servo's 15 ms show a little in the fast spin
    assert real["nominal"] > 2.5 * real["noise_floor"]


def test_recording_keeps_the_truth_apart(tmp_path):
    out, truth = tmp_path / "runs", tmp_path / "kept" / "truth.json"
    words = [str(out), "--twin", "--truth", str(truth), "--seconds", "1", "--motion", "spin"]
    assert CliRunner().invoke(record_runs, words).exit_code == 0
    assert [p.name for p in out.iterdir()] == ["spin.csv"]
    assert json.loads(truth.read_text())["effects"]
    assert "withheld" not in (out / "spin.csv").read_text() and "lag" not in (out / "spin.csv").read_text()
    assert CliRunner().invoke(record_runs, [str(out), "--truth", str(out / "truth.json")]).exit_code == 2


@pytest.mark.slow
def test_the_equation_names_what_a_twin_in_pybullet_withholds(tmp_path):
    """A lag of 90 ms (the servo adds 15) and a track 10 % wider."""
    runs = written(tmp_path / "runs", twin(bullet_drive(), Withheld(track=1.1, lag=0.09), SMOOTH), 25.0)
    found = printed("diagnose", "--robot", "diff_drive", runs, "--out", str(tmp_path / "out"))
    assert found["verdict"] == "effects"
    value = {e["effect"]: e["parameters"] for e in found["explanation"]}
    assert value["track_width"]["scale"]["value"] == pytest.approx(1.1, abs=0.02)
    assert 0.08 < value["actuator_lag"]["time_constant"]["value"] < 0.125


@pytest.mark.slow
@pytest.mark.parametrize(
    ("model", "engine", "seconds", "only"),
    [
        ("diff_drive_mujoco", bullet_drive, 15.0, "track_width,actuator_lag,wheel_radius"),
        # PyBullet has no batch: it steps row after row, in processes, so that the runs are short and the effects two
        ("diff_drive_pybullet", mujoco_drive, 8.0, "track_width,actuator_lag"),
    ],
)
def test_a_simulator_as_the_model_names_what_a_twin_in_the_other_engine_withholds(
    tmp_path, model, engine, seconds, only
):
    runs = written(tmp_path / "runs", twin(engine(), Withheld(track=1.1, lag=0.09), SMOOTH), seconds)
    found = printed("diagnose", "--robot", model, runs, "--out", str(tmp_path / "out"), "--only", only)
    assert found["verdict"] == "effects"
    value = {e["effect"]: e["parameters"] for e in found["explanation"]}
    assert set(value) == {"track_width", "actuator_lag"}
    assert value["track_width"]["scale"]["value"] == pytest.approx(1.1, abs=0.02)
    assert value["actuator_lag"]["time_constant"]["value"] == pytest.approx(0.09, abs=0.012)
