"""`residual-mpc compare`: its runs, what it prints, and what it refuses."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import pandas as pd
import pytest
from oracles.rover_log import ROBOT, rover_run, write_run

import residual_mpc as rm
from residual_mpc.cli.main import main

TRACKS = {"before": 1.0, "after": 1.1}
ONLY = ("--only", "track_width,wheel_radius")


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """rover.toml, and two runs each in before/ and, with a tenth more track, in after/."""
    place = tmp_path_factory.mktemp("rover")
    (place / "rover.toml").write_text(ROBOT)
    for first, (name, scale) in enumerate(TRACKS.items()):
        (place / name).mkdir()
        for k in range(2):
            run = rover_run(f"r{k}", {"track_width": {"scale": scale}}, 8.0, seed=2 * first + k)
            write_run(run, place / name)
    return place


@pytest.fixture
def here(place: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(place)
    return place


def call(*arguments: str) -> int:
    with pytest.raises(SystemExit) as end:
        main(["compare", "--robot", "rover.toml", *arguments])
    assert isinstance(end.value.code, int)
    return end.value.code


def written(folder: Path) -> set[Path]:
    return set(folder.rglob("*"))


def test_the_json_is_the_file_and_what_python_gives(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """With runs named one by one on the command line, and as folders from Python."""
    sets = ("--before", "before/r0.csv", "before/r1.csv", "--after", "after/r0.csv", "after/r1.csv")
    assert call(*sets, *ONLY, "--out", "answers/out", "--json", "--seed", "3") == 0
    said = capsys.readouterr()
    printed = json.loads(said.out)
    assert printed.keys() == {"compare"} and said.err  # progress, which stdout has none of
    out = here / "answers" / "out"
    assert {p.name for p in out.iterdir()} == {"comparison.json", "report.html"}
    assert json.loads((out / "comparison.json").read_text()) == printed["compare"]
    robot = rm.load_robot("rover.toml")
    before, after = (rm.read_runs(robot, name) for name in TRACKS)
    found = rm.compare(robot, before, after, only=("track_width", "wheel_radius"), seed=3)
    call_of = found.document["command"]
    assert "--before before --after after --only track_width --only wheel_radius" in call_of
    assert {**found.document, "command": ""} == {**printed["compare"], "command": ""}
    assert found.verdict == "changed" and [c["effect"] for c in found.changes] == ["track_width"]


def test_folders_and_words(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert call("--before", "before", "--after", "after", *ONLY, "--out", "told") == 0
    first, *rest = capsys.readouterr().out.splitlines()
    assert first.startswith("The effective track width increased by ")
    assert all(line.startswith("  ") for line in rest) and rest[-1] == "  report: told/report.html"
    assert any(line.startswith("  track_width: scale ") for line in rest)


def refused(here: Path, capsys: pytest.CaptureFixture[str], arguments: Sequence[str]) -> str:
    """The one message of a call that has to be refused, after which nothing more is on disk."""
    before = written(here)
    assert call(*arguments) == 2
    said = capsys.readouterr()
    assert said.out == "" and "Traceback" not in said.err and written(here) == before
    lines = [line for line in said.err.splitlines() if line and not line.startswith(("warning: ", "note: ", "["))]
    assert len(lines) == 1 or lines[0].startswith("Usage: "), said.err
    return lines[-1]


BEFORE, AFTER, OUT = ("--before", "before"), ("--after", "after"), ("--out", "out")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((*BEFORE, *OUT), "Missing option '--after'"),
        ((*AFTER, *OUT), "Missing option '--before'"),
        ((*BEFORE, *AFTER), "Missing option '--out'"),
        (("--before", *AFTER, *OUT), "'--before' needs at least one run"),
        ((*BEFORE, "--after", *OUT), "'--after' needs at least one run"),
        ((*BEFORE, *OUT, "--after"), "'--after' needs at least one run"),
        ((*BEFORE, "--after=", *OUT), "'--after' needs at least one run"),
        ((*BEFORE, "--after", "before", *OUT), "r0: the same run is in --before and in --after"),
        ((*BEFORE, "--after", "after", "before/r1.csv", *OUT), "r1: the same run is in --before and in --after"),
        ((*BEFORE, "--after", "nowhere", *OUT), "nowhere: file not found"),
        ((*BEFORE, *AFTER, *OUT, "--only", "track_with"), "unknown effect 'track_with'. Did you mean 'track_width'"),
        ((*BEFORE, *AFTER, *OUT, "--without", "trac"), "unknown effect 'trac'"),
        ((*BEFORE, *AFTER, *OUT, "--horizon", "0"), "--horizon"),
        ((*BEFORE, *AFTER, "--out", "rover.toml"), "rover.toml"),
    ],
)
def test_calls_that_make_no_sense(
    here: Path, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], said: str
) -> None:
    assert said in refused(here, capsys, arguments)


@pytest.fixture
def odd(here: Path) -> Path:
    """empty/, short/ (one run of half a second), brief/ (two of them) and arm/ (columns of another robot)."""
    for name in ("empty", "short", "brief", "arm"):
        (here / name).mkdir(exist_ok=True)
    rows = (here / "after" / "r0.csv").read_text().splitlines()
    (here / "short" / "a.csv").write_text("\n".join(rows[:12]) + "\n")
    for k in range(2):
        (here / "brief" / f"{k}.csv").write_text("\n".join([rows[0], *rows[40 + 20 * k : 51 + 20 * k]]) + "\n")
    arm = rows[0].replace("command.left", "command.j1").replace("command.right", "command.j2")
    (here / "arm" / "a.csv").write_text("\n".join([arm, *rows[1:]]) + "\n")
    return here


@pytest.mark.parametrize("side", ["--before", "--after"])
@pytest.mark.parametrize(
    ("runs", "said"),
    [
        ("empty", "empty: this folder contains no runs"),
        ("short", "one run of 0.5 s does not show how much the robot differs from itself"),
        ("arm", "command.left is missing"),
    ],
)
def test_sets_that_cannot_be_compared(
    odd: Path, capsys: pytest.CaptureFixture[str], side: str, runs: str, said: str
) -> None:
    good = AFTER if side == "--before" else BEFORE
    assert said in refused(odd, capsys, (side, runs, *good, *OUT))


def test_a_run_named_with_an_equals_sign_is_the_first_of_a_set(odd: Path, capsys: pytest.CaptureFixture[str]) -> None:
    message = refused(odd, capsys, ("--before=after/r0.csv", "after/r1.csv", "--after=after/r1.csv", *OUT))
    assert "r1: the same run" in message


def test_two_runs_of_half_a_second(odd: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Two observations do not tell how much runs of one set differ."""
    assert call(*BEFORE, "--after", "brief", *ONLY, "--out", "refused") == 2
    assert "at least 3 independent stretches are needed after the change, got 2" in capsys.readouterr().err
    assert not (odd / "refused").exists()


def test_help_names_both_sets(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        main(["compare", "--help"])
    said = capsys.readouterr().out
    assert end.value.code == 0 and all(option in said for option in ("--before RUN...", "--after RUN...", "--json"))


def test_remarks_on_both_sets_are_counted_in_one_note(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Each set had a note of its own, in the same words."""
    for name in TRACKS:
        (here / f"warm_{name}").mkdir()
        for path in (here / name).iterdir():
            table = pd.read_csv(path)
            table.assign(temperature=20.0).to_csv(here / f"warm_{name}" / path.name, index=False)
    assert call("--before", "warm_before", "--after", "warm_after", *ONLY, "--out", "once") == 0
    notes = [line for line in capsys.readouterr().err.splitlines() if line.startswith("note: ")]
    assert len(notes) == 1 and "further remark" in notes[0]
