"""`watch` from logs to events: a change is told with its beginning and its cause, steady running is not."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import residual_mpc as rm
from benchmarks.findings.records import write_drive
from benchmarks.watch import SETTINGS as ROBOTS
from benchmarks.watch import table
from residual_mpc.cli.main import main
from residual_mpc.errors import BadInput
from residual_mpc.monitoring.cause import CauseFinder
from residual_mpc.monitoring.events import document_of
from residual_mpc.monitoring.settings import DetectionSettings, WatchSettings

STEADY = ROBOTS[0]
WIDER = replace(STEADY, robot=replace(STEADY.robot, track_scale=1.1 * STEADY.robot.track_scale))
QUICK = WatchSettings(learn=240.0, detection=DetectionSettings(hours=20.0, draws=100))


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """robot.toml; steady/ with 8 min of a rover in three runs, changed/ with 4 min of it and 4 min with more track."""
    place = tmp_path_factory.mktemp("watch")
    write_drive(place, 0.05, 0.30)
    sets = {"steady": [(STEADY, 240), (STEADY, 120), (STEADY, 120)], "changed": [(STEADY, 240), (WIDER, 240)]}
    for name, parts in sets.items():
        (place / name).mkdir()
        rng = np.random.default_rng(3)
        for k, (robot, seconds) in enumerate(parts):
            header, lines = table(robot, float(seconds), rng)
            path = place / name / f"run{k}.csv"
            path.write_text("\n".join([header, *lines]) + "\n")
            os.utime(path, (1e9 + k, 1e9 + k))
    return place


def events(place: Path, logs: str, settings: WatchSettings = QUICK) -> Iterator[dict[str, Any]]:
    robot = rm.load_robot(place / "robot.toml")
    for event in rm.watch(robot, place / logs, once=True, settings=settings):
        if event is not None:
            yield document_of(event)


def test_steady_running_raises_no_alarm(place: Path) -> None:
    seen = list(events(place, "steady"))
    assert [e["event"] for e in seen if e["event"] != "gap"] == ["reference", "end"]
    assert seen[-1]["windows"] == 240 and seen[-1]["changes"] == 0
    gaps = [e["gap"] for e in seen if e["event"] == "gap"]
    assert np.median(gaps) == pytest.approx(seen[0]["gap"], rel=0.2)


def test_a_change_is_told_with_its_beginning(place: Path) -> None:
    found = next(e for e in events(place, "changed") if e["event"] == "change")
    assert found["since"]["run"] == "run1" and found["since"]["t"] < 20.0
    assert found["grew"] and found["gap"] > found["reference"] and found["unlike"] < 0.25


def test_a_watch_that_is_not_on_a_terminal_prints_its_events_alone(
    place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def find(self: CauseFinder, *_: object) -> dict[str, object]:
        self.progress("searching for what changed", 0.8)
        kept = dict.fromkeys(("changes", "confounded", "gap", "stretches", "next_experiment"))
        return {"verdict": "same", "verdict_sentence": "Nothing changed.", **kept}

    monkeypatch.setattr(CauseFinder, "find", find)
    with pytest.raises(SystemExit):
        main(["watch", "--robot", str(place / "robot.toml"), str(place / "changed"), "--once", "--learn", "4"])
    said = capsys.readouterr()
    assert "CAUSE since" in said.out and said.err == ""


@pytest.mark.slow
def test_the_cause_of_a_change_is_named(place: Path) -> None:
    causes = [e for e in events(place, "changed") if e["event"] == "cause"]
    named = causes[-1]["changes"]
    assert {c["effect"] for c in named} == {"track_width"}
    low, high = named[0]["parameters"]["scale"]["change"]["ci95"]
    assert low < 1.1 < high


def test_the_same_seed_says_the_same(place: Path) -> None:
    first, again = (list(events(place, "steady")) for _ in range(2))
    assert first == again


def test_each_line_of_json_is_an_event(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page = place / "page.html"
    with pytest.raises(SystemExit) as end:
        main(["watch", "--robot", str(place / "robot.toml"), str(place / "steady"), "--once", "--learn", "4", "--json",
              "--page", str(page)])  # fmt: skip
    assert end.value.code == 0
    seen = [json.loads(row) for row in capsys.readouterr().out.splitlines()]
    assert seen[0]["event"] == "reference" and seen[-1]["event"] == "end"
    text = page.read_text()
    assert "<svg" in text and "<script" not in text and "No certain change" in text


@pytest.mark.parametrize(
    "words",
    [
        ["nowhere"],
        ["steady", "-"],
        ["steady", "--model", "nowhere.json"],
        ["steady", "--reference", "nowhere.csv"],
        ["steady", "--learn", "0"],
    ],
)
def test_bad_input_ends_with_one_message(
    place: Path, words: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(place)
    with pytest.raises(SystemExit) as end:
        main(["watch", "--robot", "robot.toml", "--once", *words])
    said = capsys.readouterr()
    assert end.value.code == 2 and "Traceback" not in said.err and not said.out


def test_a_pipe_in_bursts_and_an_interrupt(place: Path) -> None:
    """Rows come in bursts through a pipe; SIGINT ends the watch with a summary and exit status 0."""
    lines = [r + "\n" for k in range(3) for r in (place / "steady" / f"run{k}.csv").read_text().splitlines()]
    header, rows = lines[0], [r for r in lines[1:4801] if not r.startswith("t,")]
    program = [sys.executable, "-m", "residual_mpc.cli.main", "watch", "--robot", "robot.toml", "-", "--json",
               "--learn", "3"]  # fmt: skip
    root = Path(__file__).resolve().parents[2]
    environment = {**os.environ, "PYTHONPATH": str(root)}
    with subprocess.Popen(program, cwd=place, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                          text=True, env=environment) as process:  # fmt: skip
        assert process.stdin is not None and process.stdout is not None
        process.stdin.write(header)
        for k in range(0, len(rows), 1200):
            process.stdin.write("".join(rows[k : k + 1200]))
            process.stdin.flush()
            time.sleep(0.1)
        first = process.stdout.readline()
        assert json.loads(first)["event"] == "reference"
        second = process.stdout.readline()
        assert json.loads(second)["event"] == "gap"
        process.send_signal(signal.SIGINT)
        rest = process.stdout.read().splitlines()
        assert process.wait(timeout=60) == 0
    assert json.loads(rest[-1])["event"] == "end"
    assert all(json.loads(r)["event"] != "change" for r in rest)


def test_the_reference_is_the_runs_of_the_diagnosis(place: Path, tmp_path: Path) -> None:
    """A model beside a diagnosis.json takes that file's runs, which are listed relative to its folder, as reference."""
    document = {
        "schema": "residual-mpc/diagnosis/1", "run_files": [os.path.relpath(place / "steady", tmp_path)],
        "model": {"schema": "residual-mpc/model/1", "robot": "rover", "values": []},
    }  # fmt: skip
    (tmp_path / "diagnosis.json").write_text(json.dumps(document))
    (tmp_path / "model.json").write_text(json.dumps(document["model"]))
    robot = rm.load_robot(place / "robot.toml")
    first = next(rm.watch(robot, place / "changed", model=tmp_path / "model.json", once=True, settings=QUICK))
    assert first is not None
    told = document_of(first)
    assert told["event"] == "reference" and told["runs"] == 3 and told["windows"] == 480
    assert "diagnosis.json" in told["source"]


def test_runs_of_the_diagnosis_that_this_robot_file_does_not_read_are_no_reference(place: Path, tmp_path: Path) -> None:
    (tmp_path / "first.csv").write_text("time,speed\n0,1\n1,1\n")
    document = {
        "schema": "residual-mpc/diagnosis/1", "run_files": ["first.csv"],
        "model": {"schema": "residual-mpc/model/1", "robot": "rover", "values": []},
    }  # fmt: skip
    (tmp_path / "diagnosis.json").write_text(json.dumps(document))
    robot = rm.load_robot(place / "robot.toml")
    with pytest.raises(BadInput, match=r"runs of the model's diagnosis cannot serve .* as `reference`"):
        next(rm.watch(robot, place / "changed", model=tmp_path / "diagnosis.json", once=True, settings=QUICK))
