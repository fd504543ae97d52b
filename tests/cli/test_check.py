"""`check` lists every fault of a call at once, and its exit status says whether the runs can be used."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from oracles.rover_log import ROBOT, rover_run, write_run

from residual_mpc.cli.main import main


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    there = tmp_path_factory.mktemp("rover")
    (there / "rover.toml").write_text(ROBOT)
    write_run(rover_run("one", {}, 6.0, seed=1), there)
    (there / "text.csv").write_text("t,command.left,command.right,pose.x\n0,1,1,0\n0.1,1,fast,0\n")
    (there / "half.csv").write_text("t,command.left,pose.x\n0,1,0\n0.1,1,0\n0.2,1,0\n")
    return there


def check(folder: Path, capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, str, str]:
    """(exit status, stdout, stderr)."""
    paths = [word if word.startswith("--") else str(folder / word) for word in words]
    with pytest.raises(SystemExit) as end:
        main(["check", "--robot", str(folder / "rover.toml"), *paths])
    said = capsys.readouterr()
    return int(end.value.code or 0), said.out, said.err


def test_a_sound_run_is_described(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, out, err = check(folder, capsys, "one.csv")
    assert status == 0 and err == ""
    assert "compared: pose.x, pose.y, pose.theta" in out and out.rstrip().endswith("usable")


def test_every_fault_is_listed_beside_what_can_be_read(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    names = ("one.csv", "text.csv", "half.csv", "absent.csv")
    status, out, err = check(folder, capsys, *names, "--json")
    document: dict[str, Any] = json.loads(out)
    errors = [f for f in document["findings"] if f["severity"] == "error"]
    told = " ".join(f["run"] + f["message"] for f in errors)
    assert status == 2 and document["usable"] is False and "Traceback" not in err
    assert len(errors) == 3 and all(name in told for name in ("text.csv", "absent.csv", "command.right"))
    assert all(f["remedy"] for f in errors)
    assert {r["run"] for r in document["runs"]} == {"one", "half"}


def test_a_run_as_json(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _, out, _ = check(folder, capsys, "one.csv", "--json")
    (run,) = json.loads(out)["runs"]
    assert run["commands"] == ["command.left", "command.right"]
    assert run["compared"] == ["pose.x", "pose.y", "pose.theta"]
    assert run["rate"] == pytest.approx((run["samples"] - 1) / run["seconds"], rel=1e-3)


def test_faults_of_one_kind_share_a_line(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("twin1.csv", "twin2.csv"):
        (folder / name).write_text((folder / "text.csv").read_text())
    status, out, _ = check(folder, capsys, "twin1.csv", "twin2.csv")
    assert status == 2 and out.count("must be a number") == 1 and "and 1 more" in out


def test_a_track_in_millimetres_is_remarked(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    wide = folder / "wide.toml"
    wide.write_text(ROBOT.replace("0.16", "160"))
    for command in ("check", "gap"):
        with pytest.raises(SystemExit) as end:
            main([command, "--robot", str(wide), str(folder / "one.csv")])
        said = capsys.readouterr()
        assert not end.value.code
        assert "warning: track_width is 160 m, more than 20 m" in said.out + said.err
