"""`check` lists every fault of a call at once, and its exit status says whether the runs can be used."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
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


def test_a_strange_channel_is_named_once(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = rover_run("odd", {}, 6.0, seed=2)
    odd = write_run(replace(run, columns={**run.columns, "position.arm": run.columns["pose.x"]}), folder)
    for command in ("check", "gap"):
        with pytest.raises(SystemExit):
            main([command, "--robot", str(folder / "rover.toml"), str(odd)])
        said = capsys.readouterr()
        (line,) = [line for line in (said.out + said.err).splitlines() if "does not predict" in line]
        assert line.count("position.arm") == 1 and line.startswith("warning: ") and line == line.rstrip()


def test_a_fault_of_the_robot_file_is_one_and_not_of_a_run(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    typo = folder / "typo.toml"
    typo.write_text(ROBOT + '[log]\n"pose.theta" = "yaww"\n')
    for seed, name in ((4, "three"), (5, "four")):
        write_run(rover_run(name, {}, 6.0, seed=seed), folder)
    table = (folder / "three.csv").read_text().replace("pose.theta", "yaw")
    for name in ("three", "four"):
        (folder / f"{name}.csv").write_text(table)
    with pytest.raises(SystemExit) as end:
        main(["check", "--robot", str(typo), str(folder / "three.csv"), str(folder / "four.csv")])
    said = capsys.readouterr()
    assert end.value.code == 2 and "more run" not in said.out and said.out.count("yaww") == 1
    assert "1 error to fix" in said.err


def test_sensors_that_share_a_table_are_as_slow_as_the_check_lists(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Commands, wheels and poses have rows of their own; the table's rate is that of the fastest of them."""
    run = rover_run("shared", {}, 12.0, seed=3)
    of = {"command": 0, "velocity": 1, "pose": 2}
    rows = 3 * len(run.t)
    columns = {name: np.full(rows, np.nan) for name in (*run.columns, "velocity.left", "velocity.right")}
    for name, column in columns.items():
        values = run.columns.get(name, run.columns["command.left"])
        column[of[name.partition(".")[0]] :: 3] = values
        if name.startswith("pose"):
            column[2::6] = np.nan  # half as fast as the rest
    t = np.sort(np.concatenate([run.t, run.t + 0.2 * run.period, run.t + 0.4 * run.period]))
    write_run(replace(run, t=t, columns=columns), folder)
    _, out, _ = check(folder, capsys, "shared.csv")
    slow = [line for line in out.splitlines() if "updates at" in line]
    assert {line.split()[1] for line in slow} == {"pose.x", "pose.y", "pose.theta"}
    said = [[float(x) for x in re.findall(r"([\d.]+) Hz", line)] for line in slow]
    assert said == [[pytest.approx(0.5 / run.period, rel=0.02), pytest.approx(1.0 / run.period, rel=1e-3)]] * 3
    assert f"{1.0 / run.period:.1f} Hz" in out
