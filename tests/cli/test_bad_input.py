"""What cannot be used ends with exit status 2 and one clear message: no traceback, nothing half-written."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from oracles.arms import arm_xml
from oracles.rover_log import ROBOT, rover_run, write_run

from residual_mpc.cli.main import main

MODEL = {
    "schema": "residual-mpc/model/1",
    "robot": "arm",
    "values": [{"effect": "payload", "target": None, "parameter": "mass", "value": 0.3}],
}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A rover's robot file and two good runs, in the folder that the user stands in."""
    (tmp_path / "rover.toml").write_text(ROBOT)
    for seed, name in ((1, "one"), (2, "two")):
        write_run(rover_run(name, {}, 6.0, seed=seed), tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def refused(capsys: pytest.CaptureFixture[str], folder: Path, *arguments: str) -> str:
    """The message of a call that has to be refused."""
    before = sorted(p for p in folder.rglob("*"))
    with pytest.raises(SystemExit) as end:
        main(arguments)
    said = capsys.readouterr()
    assert end.value.code == 2, said.err
    assert said.out == ""
    assert "Traceback" not in said.err
    message = [line for line in said.err.splitlines() if not line.startswith(("warning: ", "note: ", "["))]
    assert len(message) == 1 or message[0].startswith("Usage: "), said.err
    after = sorted(p for p in folder.rglob("*"))
    assert [p for p in after if p not in before] == []
    return message[-1]


def edit(name: str, change: Callable[[list[list[str]]], list[list[str]]]) -> None:
    """Rewrite a CSV: change takes and gives its rows of cells, the header first."""
    rows = [line.split(",") for line in Path(name).read_text().splitlines()]
    Path(name).write_text("\n".join(",".join(r) for r in change(rows)) + "\n")


def column(name: str, header: str, cell: Callable[[int, str], str]) -> None:
    """Rewrite one column: cell takes the row's number and its old text."""

    def change(rows: list[list[str]]) -> list[list[str]]:
        k = rows[0].index(header)
        return [rows[0], *([*r[:k], cell(i, r[k]), *r[k + 1 :]] for i, r in enumerate(rows[1:]))]

    edit(name, change)


GAP = ("gap", "--robot", "rover.toml")
DIAGNOSE = ("diagnose", "--robot", "rover.toml", "--out", "out")


@pytest.mark.parametrize("command", [GAP, DIAGNOSE])
@pytest.mark.parametrize(
    ("run", "said"), [("nowhere.csv", "nowhere.csv"), ("empty.csv", "empty.csv"), ("noise.csv", "noise.csv")]
)
def test_runs_that_cannot_be_read(
    folder: Path, capsys: pytest.CaptureFixture[str], command: tuple[str, ...], run: str, said: str
) -> None:
    (folder / "empty.csv").write_text("")
    (folder / "noise.csv").write_bytes(bytes(range(256)) * 4)
    assert said in refused(capsys, folder, *command, "one.csv", run)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("name = ", "not valid TOML"),
        ('plant = "hovercraft"', "unknown plant 'hovercraft'"),
        ('plant = "nowhere.at_all:make"', "cannot be imported"),
        ('plant = "json:nothing"', "has no factory"),
        ('plant = "json:loads"', "failed"),
        ('plant = "builtins:repr"', "without name, actuators"),
        ('name = "x"', "'plant' is missing"),
        (ROBOT.replace("0.16", "-0.16"), "positive length"),
        ('plant = "mujoco"\nmodel = "gone.xml"', "not found"),
        ('plant = "mujoco"\nmodel = "broken.xml"', "does not compile"),
        ('plant = "mujoco"', "key 'model' is missing"),
    ],
)
def test_robot_files_that_are_no_robot(folder: Path, capsys: pytest.CaptureFixture[str], text: str, said: str) -> None:
    (folder / "broken.xml").write_text(arm_xml().replace("</mujoco>", ""))
    (folder / "robot.toml").write_text(text)
    assert said in refused(capsys, folder, "gap", "--robot", "robot.toml", "one.csv")


def test_a_robot_that_is_not_there(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "nowhere.toml" in refused(capsys, folder, "gap", "--robot", "nowhere.toml", "one.csv")


def test_a_command_that_the_robot_needs_is_missing(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    edit("one.csv", lambda rows: [[c.replace("command.left", "command.lift") for c in rows[0]], *rows[1:]])
    message = refused(capsys, folder, *GAP, "one.csv")
    assert "command.left is missing" in message and "command.lift" in message


def test_nothing_measured_that_the_robot_could_predict(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    edit("one.csv", lambda rows: [[c.replace("pose.", "position.") for c in rows[0]], *rows[1:]])
    assert "pose.x" in refused(capsys, folder, *GAP, "one.csv")


def test_a_run_of_one_sample(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    edit("one.csv", lambda rows: rows[:2])
    assert "one" in refused(capsys, folder, *DIAGNOSE, "one.csv", "two.csv")


def test_a_command_that_is_no_number(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """From the first row on: there is nothing to hold."""
    column("one.csv", "command.left", lambda i, cell: "nan")
    assert "command.left" in refused(capsys, folder, *DIAGNOSE, "one.csv", "two.csv")


def test_a_cell_that_is_a_word(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    column("one.csv", "pose.x", lambda i, cell: "far" if i == 17 else cell)
    message = refused(capsys, folder, *GAP, "one.csv")
    assert "pose.x" in message and "far" in message


def test_stamps_that_run_backwards(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    column("one.csv", "t", lambda i, cell: str(-float(cell)))
    assert "one" in refused(capsys, folder, *GAP, "one.csv")


def test_headings_in_degrees(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Found by the audit, before anything is fitted."""
    for name in ("one.csv", "two.csv"):
        column(name, "pose.theta", lambda i, cell: str(np.degrees(float(cell))))
    message = refused(capsys, folder, *DIAGNOSE, "one.csv", "two.csv")
    assert "pose.theta" in message and "deg" in message


@pytest.mark.parametrize("horizon", ["-1", "0", "nan", "1e9", "two"])
def test_windows_of_no_length(folder: Path, capsys: pytest.CaptureFixture[str], horizon: str) -> None:
    assert "--horizon" in refused(capsys, folder, *GAP, "one.csv", "--horizon", horizon)


def test_a_folder_for_the_answer_that_is_a_file(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "taken").write_text("mine")
    message = refused(capsys, folder, "diagnose", "--robot", "rover.toml", "one.csv", "--out", "taken")
    assert "taken" in message and (folder / "taken").read_text() == "mine"


def test_a_folder_within_a_file(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Only found when the answer is written: still one message, and nothing half-written."""
    (folder / "taken").write_text("mine")
    message = refused(capsys, folder, "diagnose", "--robot", "rover.toml", "one.csv", "--out", "taken/deep")
    assert "taken" in message


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="nothing is forbidden to this user")
def test_a_folder_that_may_not_be_written(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "locked").mkdir(mode=0o500)
    assert "locked" in refused(capsys, folder, "diagnose", "--robot", "rover.toml", "one.csv", "--out", "locked/deep")


@pytest.mark.parametrize("option", ["--only", "--without"])
def test_an_effect_that_nobody_knows(folder: Path, capsys: pytest.CaptureFixture[str], option: str) -> None:
    message = refused(capsys, folder, *DIAGNOSE, "one.csv", option, "track_with")
    assert "track_with" in message and "track_width" in message


def test_a_held_out_run_that_does_not_exist(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    message = refused(capsys, folder, *DIAGNOSE, "one.csv", "two.csv", "--held-out", "three")
    assert "three" in message and "one, two" in message


def test_holding_every_run_out(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    held = ("--held-out", "one", "--held-out", "two")
    assert "held out" in refused(capsys, folder, *DIAGNOSE, "one.csv", "two.csv", *held)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (json.dumps(MODEL), "payload"),
        (json.dumps({**MODEL, "schema": "residual-mpc/model/9"}), "schema"),
        (json.dumps({**MODEL, "values": [{"effect": "payload"}]}), "cannot be read"),
        (json.dumps({**MODEL, "values": None}), "cannot be read"),
        (json.dumps({**MODEL, "values": [{**MODEL["values"][0], "effect": "magic"}]}), "magic"),  # type: ignore[index,dict-item]
        (json.dumps({**MODEL, "values": [{**MODEL["values"][0], "effect": "tune"}]}), "mass"),  # type: ignore[index,dict-item]
        (json.dumps({**MODEL, "values": [{**MODEL["values"][0], "value": float("nan")}]}), "model.json"),  # type: ignore[index,dict-item]
        ('{"schema": "residual-mpc/diagnosis/1"}', "model.json"),
        ("[1, 2]", "must be a JSON object"),
        ("{", "not valid JSON"),
    ],
)
def test_a_model_of_another_robot_or_of_none(
    folder: Path, capsys: pytest.CaptureFixture[str], content: str, said: str
) -> None:
    (folder / "model.json").write_text(content)
    message = refused(capsys, folder, *GAP, "one.csv", "--model", "model.json")
    assert said in message and "model.json" in message


@pytest.mark.parametrize("to", ["casadi", "mjcf"])
@pytest.mark.parametrize("model", [7, None, [], {"schema": "somebody/model/1"}])
def test_a_diagnosis_without_a_model_is_not_exported(
    folder: Path, capsys: pytest.CaptureFixture[str], model: object, to: str
) -> None:
    content = {"schema": "residual-mpc/diagnosis/1", "robot": "rover", "model": model}
    (folder / "diagnosis.json").write_text(json.dumps(content))
    message = refused(capsys, folder, "export", "diagnosis.json", "--to", to, "--robot", "rover.toml")
    assert "contains no valid model" in message


@pytest.mark.parametrize(
    "held",
    [
        [],
        ["three"],
        [7],
        [{"run": "one"}],
        [{"run": "one", "from": 90.0, "to": 99.0}],
        "one",
        7,
        None,
        [{"run": "one", "from": "now", "to": []}],
    ],
)
def test_a_diagnosis_of_other_runs(folder: Path, capsys: pytest.CaptureFixture[str], held: object) -> None:
    (folder / "diagnosis.json").write_text(json.dumps({"schema": "residual-mpc/diagnosis/1", "held_out": held}))
    refused(capsys, folder, *GAP, "one.csv", "--held-out-of", "diagnosis.json")


@pytest.mark.parametrize(
    "arguments",
    [
        ("fly",),
        ("gap",),
        ("gap", "one.csv"),
        ("gap", "--robot", "rover.toml"),
        ("diagnose", "--robot", "rover.toml", "one.csv"),  # no --out
        ("gap", "--robot", "rover.toml", "one.csv", "--seed", "many"),
        ("gap", "--robot", "rover.toml", "one.csv", "--nonsense"),
        (*DIAGNOSE, "one.csv", "--seed", "-1"),
    ],
)
def test_calls_that_make_no_sense(folder: Path, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...]) -> None:
    refused(capsys, folder, *arguments)


def test_a_channel_without_a_start(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Measured only once, far from every window's start."""
    column("one.csv", "pose.x", lambda i, cell: cell if i == 70 else "")
    refused(capsys, folder, *GAP, "one.csv")


def test_a_robot_that_never_moves(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rng = np.random.default_rng(0)
    for header in ("pose.x", "pose.y", "pose.theta"):
        column("one.csv", header, lambda i, cell: f"{1e-3 * rng.standard_normal():.6f}")
    refused(capsys, folder, *DIAGNOSE, "one.csv")


def test_a_video_that_cannot_be_written_is_refused_before_the_diagnosis(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    said = refused(capsys, folder, *DIAGNOSE, "--video", "motion.avi", "one.csv", "two.csv")
    assert "--video" in said and ".webp" in said
