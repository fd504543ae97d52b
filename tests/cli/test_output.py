"""What the commands print: JSON alone on stdout where it is asked for, words elsewhere, help at once."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from oracles.rover_log import ROBOT, rover_run, write_run

from residual_mpc.cli.main import main
from residual_mpc.report import diagnosis_lines, gap_lines

TRACK = {"track_width": {"scale": 1.25}}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    there = tmp_path_factory.mktemp("rover")
    (there / "rover.toml").write_text(ROBOT)
    for seed, name in ((1, "one"), (2, "two")):
        write_run(rover_run(name, TRACK, 12.0, seed=seed), there)
    return there


def call(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """As a user does, in a process of its own."""
    program = [sys.executable, "-m", "residual_mpc.cli.main", *arguments]
    return subprocess.run(program, cwd=cwd, capture_output=True, text=True, check=False)


def printed(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[dict[str, Any], str]:
    """The JSON that the command prints, in this process, and what it says besides."""
    with pytest.raises(SystemExit) as end:
        main([*arguments, "--json"])
    assert end.value.code == 0
    said = capsys.readouterr()
    return json.loads(said.out), said.err


def test_the_gap_as_json(folder: Path) -> None:
    done = call("gap", "--robot", "rover.toml", "one.csv", "two.csv", "--json", cwd=folder)
    assert done.returncode == 0
    gap = json.loads(done.stdout)
    assert set(gap) >= {"nominal", "model", "noise_floor", "horizon", "windows", "skipped", "still", "channels"}
    assert set(gap["channels"]) == {"pose.x", "pose.y", "pose.theta"}
    assert all(set(c) >= {"nominal", "model", "noise_floor"} for c in gap["channels"].values())
    assert gap["model"] is None and gap["windows"] == 24 and gap["horizon"] == 1.0


def test_the_gap_in_words(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        main(["gap", "--robot", str(folder / "rover.toml"), str(folder / "one.csv")])
    said = capsys.readouterr().out
    assert end.value.code == 0 and "noise floor" in said and "pose.theta" in said


def test_the_built_in_robot_by_name(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert printed(capsys, "gap", "--robot", "diff_drive", str(folder / "one.csv"))[0]["nominal"] > 0.1


def test_a_diagnosis_as_json_and_as_files(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(folder)
    options = ("--robot", "rover.toml", "one.csv", "two.csv", "--out", "answers/rover", "--seed", "3",
               "--only", "track_width,command_delay")  # fmt: skip
    earlier = folder / "answers" / "rover" / "next.csv"
    earlier.parent.mkdir(parents=True)
    earlier.write_text("what a diagnosis that left something open has proposed")
    document, progress = printed(capsys, "diagnose", *options)
    out = folder / "answers" / "rover"
    assert json.loads((out / "diagnosis.json").read_text()) == document
    assert {"diagnosis.json", "model.json", "report.html"} <= {p.name for p in out.iterdir()}
    assert not [p for p in out.iterdir() if p.suffix == ".part"]
    assert document["next_experiment"] is None and not earlier.exists()
    assert progress  # which stdout has none of


@pytest.mark.slow
def test_a_diagnosis_in_words(folder: Path, tmp_path: Path) -> None:
    done = call("diagnose", "--robot", "rover.toml", "one.csv", "--out", str(tmp_path / "out"), cwd=folder)
    assert done.returncode == 0
    assert "track_width" in done.stdout and "gap" in done.stdout and "report.html" in done.stdout


def test_unknown_columns_are_kept_and_do_no_harm(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = (folder / "one.csv").read_text().splitlines()
    text = "\n".join([rows[0] + ",mood", *(r + ",good" for r in rows[1:])])
    (tmp_path / "one.csv").write_text(text)
    robot = str(folder / "rover.toml")
    there, plain = (printed(capsys, "gap", "--robot", robot, str(f / "one.csv"))[0] for f in (tmp_path, folder))
    assert there == plain


def test_help_lists_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        main(["--help"])
    said = capsys.readouterr().out
    assert end.value.code == 0
    assert all(f"  {name}" in said for name in ("check", "gap", "diagnose", "compare", "blind"))


@pytest.mark.parametrize("command", ["gap", "diagnose", "check", "compare"])
def test_every_command_has_help_json_and_seed(capsys: pytest.CaptureFixture[str], command: str) -> None:
    with pytest.raises(SystemExit) as end:
        main([command, "--help"])
    said = capsys.readouterr().out
    assert end.value.code == 0 and "--json" in said and "--seed" in said and "--robot" in said


def test_the_version(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        main(["--version"])
    assert end.value.code == 0 and capsys.readouterr().out.strip()


def test_the_answer_is_on_disk_before_its_report(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Whatever stops what comes after the answer, the answer is whole, and no older report stands beside it."""
    import residual_mpc.api.diagnosis

    def stopped(*arguments: object) -> str:
        raise KeyboardInterrupt

    monkeypatch.setattr(residual_mpc.api.diagnosis, "compose", stopped)
    out = tmp_path / "out"
    out.mkdir()
    (out / "report.html").write_text("of an earlier diagnosis")
    call = ["diagnose", "--robot", str(folder / "rover.toml"), str(folder / "one.csv"), "--out", str(out)]
    with pytest.raises(SystemExit) as end:
        main([*call, "--only", "track_width"])
    assert end.value.code == 1
    assert "residual-mpc: stopped; run the same command again to resume" in capsys.readouterr().err
    assert {p.name for p in out.iterdir()} == {"diagnosis.json", "model.json", "resume.bin"}
    document = json.loads((out / "diagnosis.json").read_text())
    assert document["verdict"] == "effects" and "still running, or was stopped" in document["notes"][-1]
    assert json.loads((out / "model.json").read_text()) == document["model"]


def test_the_gap_of_a_model_that_diverges_comes_with_words() -> None:
    gap = {
        "nominal": 4080.0, "model": None, "noise_floor": 0.1, "horizon": 1.0, "windows": 3, "skipped": 1,
        "still": ["pose.y"],
        "channels": {"pose.x": {"nominal": 4080.0, "model": None, "noise_floor": 0.1}}, "constant_velocity": 0.4,
    }  # fmt: skip
    said = gap_lines(gap)
    assert said[0] == "gap at 1 s: 4080 (noise floor 0.1), 3 windows"
    assert "This model predicts worse than a constant-velocity forecast (0.4)" in said[3]
    assert "diverges to 4080 times the motion itself" in said[4]
    assert said[-1] == "1 window skipped: no sample within 0.25 s of the start"


def test_every_horizon_has_a_line() -> None:
    one = {"nominal": 0.12, "model": 0.03, "noise_floor": 0.02, "horizon": 1.0, "windows": 24, "skipped": 0,
           "still": [], "channels": {}, "window_gaps": {"model": {"p50": 0.001, "p90": 0.02, "max": 0.3}}}  # fmt: skip
    far = {**one, "horizon": 5.0, "held_out": False, "windows": 4}
    assert gap_lines({**one, "horizons": [one, far]}) == [
        "gap at 1 s: 0.12 -> 0.03 (noise floor 0.02), 24 windows",
        "gap at 5 s: 0.12 -> 0.03 (noise floor 0.02), 4 windows, not held out",
        "A few windows dominate the gap at 1 s: the median over the windows is 0.001, the maximum 0.3.",
    ]


def test_a_diagnosis_in_lines() -> None:
    effect = {"effect": "actuator_gain", "target": "left", "probability": 0.97, "note": "rests on a bound",
              "parameters": {"gain": {"value": 0.9, "ci95": [0.88, 0.92], "unit": "1",
                                      "note": "at its bound"}}}  # fmt: skip
    document = {
        "verdict": "effects", "held_out": ["two"], "explanation": [effect], "confounded": [],
        "gap": {"before": 0.2, "after": 0.03, "noise_floor": 0.02, "horizon": 1.0, "constant_velocity": 0.4},
        "shrink": {"expected": 0.85, "expected_ci95": [0.8, 0.9], "value": 0.86, "ci95": [0.83, 0.89]},
    }  # fmt: skip
    assert diagnosis_lines(document) == [
        "The left wheel delivers 90 % of its modelled output; modelling this removes 86 % of the gap on held-out runs.",
        "  gap at 1 s: 0.2 -> 0.03 (noise floor 0.02)",
        "  gap of a constant-velocity forecast: 0.4",
        "  shrink expected 85 % (80 % to 90 %), achieved 86 % on held-out runs",
        "  actuator_gain [left]: gain = 0.900 (0.880 to 0.920) (at its bound), probability 0.97 (rests on a bound)",
    ]
