"""What a user knows before a diagnosis is finished, and what Ctrl-C leaves."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from oracles.rover_log import ROBOT, rover_run, write_run
from short_films import PROGRAM

import residual_mpc as rm
from residual_mpc.report.words.early import first_look_sentence, so_far_sentence

LATE = {"command_delay": {"delay": 0.08}}
ONLY = "command_delay,actuator_lag,track_width"


@pytest.fixture(scope="module")
def rover(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("rover")
    (folder / "robot.toml").write_text(ROBOT)
    for k in range(2):
        write_run(rover_run(f"run{k}", LATE, seconds=20.0, seed=k), folder)
    return folder


INTERRUPTED = """
import os, signal, sys
from residual_mpc.api import early_answers
from residual_mpc.cli.main import main
write = early_answers.write_json
def then_stop(path, document):
    write(path, document)
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a job in the background is born deaf to it
    os.kill(os.getpid(), signal.SIGINT)
early_answers.write_json = then_stop
main(sys.argv[1:])
"""


def command(folder: Path, interrupted: bool) -> subprocess.CompletedProcess[str]:
    """The command, with short films; interrupted: as by Ctrl-C once there is an answer so far."""
    program = ["-c", INTERRUPTED if interrupted else PROGRAM]
    words = ["diagnose", "--robot", "robot.toml", "run0.csv", "run1.csv", "--out", "out", "--only", ONLY]
    return subprocess.run([sys.executable, *program, *words], cwd=folder, capture_output=True, text=True, check=False)


def test_a_first_look_and_better_sets_are_told(rover: Path) -> None:
    robot = rm.load_robot(rover / "robot.toml")
    runs = rm.read_runs(robot, [rover / "run0.csv", rover / "run1.csv"])
    said: list[str] = []
    quiet = rm.diagnose(robot, runs, only=ONLY.split(","))
    found = rm.diagnose(robot, runs, only=ONLY.split(","), say=said.append)
    assert said[0].startswith("first look: the gap is about") and "command delay" in said[0]
    assert all(line.startswith("so far: commands take effect") for line in said[1:]) and len(said) > 1
    assert found.document["explanation"] == quiet.document["explanation"]  # to be told changes nothing


def test_ctrl_c_leaves_the_best_answer_so_far(rover: Path) -> None:
    out, stopped = rover / "out", command(rover, interrupted=True)
    said = stopped.stderr
    assert stopped.returncode == 1 and "Traceback" not in said
    assert "the best answer so far is out/unfinished.json" in said
    assert ("run the same command again to continue" in said) == (out / "resume.bin").exists()
    assert not (out / "diagnosis.json").exists() and not (out / "model.json").exists()

    robot = rm.load_robot(rover / "robot.toml")
    runs = rm.read_runs(robot, [rover / "run0.csv", rover / "run1.csv"])
    unfinished = json.loads((out / "unfinished.json").read_text())["unfinished"]
    assert "none of it has been tested" in unfinished["note"]
    assert unfinished["explanation"][0]["effect"] == "command_delay"
    assert unfinished["explanation"][0]["parameters"]["delay"]["value"] == pytest.approx(0.08, abs=0.01)
    measured = rm.measure_gap(robot, runs, model=out / "unfinished.json")
    assert measured.model < 0.5 * measured.nominal

    finished = command(rover, interrupted=False)
    assert finished.returncode == 0, finished.stderr
    assert (out / "diagnosis.json").is_file() and not (out / "unfinished.json").exists()


def test_a_perfect_robot_resembles_nothing(tmp_path: Path) -> None:
    (tmp_path / "robot.toml").write_text(ROBOT)
    write_run(rover_run("run0", {}, seconds=20.0), tmp_path)
    robot, said = rm.load_robot(tmp_path / "robot.toml"), list[str]()
    found = rm.diagnose(robot, rm.read_runs(robot, [tmp_path / "run0.csv"]), only=["command_delay"], say=said.append)
    assert found.verdict == "no_gap" and len(said) == 1 and "resembles" not in said[0]


def test_words() -> None:
    look = {"horizon": 1.0, "gap": 0.2, "noise_floor": 0.01, "channels": {"pose.x": 0.7, "pose.y": 0.3},
            "leads": [{"effect": "viscous_friction", "target": "j1", "shrink": 0.5}]}  # fmt: skip
    assert first_look_sentence(look) == (
        "first look: the gap is about 0.2 at 1 s (noise floor 0.01), largest in pose.x (70 %); it most resembles "
        "viscous friction of j1 (50 %)"
    )
    delay = {"effect": "command_delay", "target": None, "parameters": {"delay": {"value": 0.04, "unit": "s"}}}
    gap = {"before": 0.2, "after": 0.05, "noise_floor": 0.01, "horizon": 5.0, "windows": 12}
    assert so_far_sentence({"gap": gap, "explanation": [delay]}) == (
        "so far: commands take effect 40 ms late; gap 0.2 -> 0.05 at 5 s (noise floor 0.01)"
    )
