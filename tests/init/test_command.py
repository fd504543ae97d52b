"""The command `init`: what it writes and prints, what it refuses, and that the next command works."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from init.arm_logs import JOINTS, mjcf, simulate, write

from residual_mpc.cli.main import main
from residual_mpc.models.load import load_robot
from residual_mpc.models.robot_file import read_robot_file


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    there = tmp_path_factory.mktemp("init")
    (there / "arm.xml").write_text(mjcf())
    (there / "broken.xml").write_text("<mujoco><worldbody><body></worldbody></mujoco>")
    table = simulate(seconds=14.0)
    write(there, table, "log.csv")
    strange = table.rename(columns={c: c.split(".")[-1] + "_" + c.split(".")[0] for c in table.columns[1:]})
    write(there, strange.rename(columns={"t": "stamp_ms"}).assign(stamp_ms=1e3 * table["t"]), "strange.csv")
    write(there, table.head(1), "short.csv")
    write(there, table.drop(columns="t"), "timeless.csv")
    write(there, table[["t"]].assign(weather=table["t"] ** 2), "else.csv")
    return there


def call(capsys: pytest.CaptureFixture[str], *words: str | Path) -> tuple[int, str, str]:
    """(exit status, stdout, stderr)."""
    with pytest.raises(SystemExit) as end:
        main([str(word) for word in words])
    said = capsys.readouterr()
    return int(end.value.code or 0), said.out, said.err


def test_it_writes_a_robot_that_the_next_command_takes(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "arm.toml"
    status, said, guesses = call(capsys, "init", folder / "arm.xml", folder / "log.csv", "--out", out)
    assert status == 0 and f"next: residual-mpc gap --robot {out} {folder / 'log.csv'}" in said
    assert "guess: command.elbow = command.elbow" in guesses and "%" in guesses
    assert load_robot(read_robot_file(out)).actuators == ("shoulder", "elbow")
    assert "# " in out.read_text() and "(9" in out.read_text()
    status, said, _ = call(capsys, "gap", "--robot", out, folder / "log.csv")
    assert status == 0 and "gap" in said


def test_json_is_one_object(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "arm.toml"
    _, said, _ = call(capsys, "init", folder / "arm.xml", folder / "log.csv", "--out", out, "--json")
    document: dict[str, Any] = json.loads(said)["init"]
    assert document["robot"] == str(out) and document["usable"] and document["unmatched"] == []
    assert all({"what", "value", "why", "sure"} <= set(g) and 0 <= g["sure"] <= 1 for g in document["guesses"])


def test_mended_runs_are_usable(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, mended = tmp_path / "arm.toml", tmp_path / "mended"
    _, said, guesses = call(capsys, "init", folder / "arm.xml", folder / "strange.csv", "--out", out)
    assert "to correct in the log: write the column stamp_ms as 0.001 * stamp_ms" in guesses and "--mended" in said
    assert "0.001 * stamp_ms" in out.read_text()
    words = ("init", folder / "arm.xml", folder / "strange.csv", "--out", out, "--force", "--mended", mended)
    assert call(capsys, *words)[0] == 0
    status, said, _ = call(capsys, "check", "--robot", out, mended)
    assert status == 0 and "usable" in said
    whole = pd.read_parquet(mended / "strange.parquet")
    assert whole["stamp_ms"].iloc[-1] == pytest.approx(13.99) and len(whole.columns) == 7
    status, _, said = call(capsys, "init", folder / "arm.xml", mended, "--out", tmp_path / "again.toml")
    assert status == 2 and "strange.parquet: init has already corrected these runs" in said
    assert not (tmp_path / "again.toml").exists()


def test_a_robot_file_is_not_overwritten_unasked(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "robot.toml").write_text("mine")
    status, _, said = call(capsys, "init", folder / "arm.xml", folder / "log.csv", "--out", tmp_path)
    assert status == 2 and "--force" in said and (tmp_path / "robot.toml").read_text() == "mine"


@pytest.mark.parametrize(
    ("model", "run", "said"),
    [
        ("absent.xml", "log.csv", "model file not found"),
        ("log.csv", "log.csv", "does not compile"),
        ("broken.xml", "log.csv", "does not compile"),
        ("arm.xml", "absent.csv", "file not found"),
        ("arm.xml", "short.csv", "at least two samples, got one"),
        ("arm.xml", "timeless.csv", "no time column was found"),
        ("arm.xml", "else.csv", "no column matches a command of shoulder, elbow"),
        ("arm.xml", "arm.xml", ""),
    ],
)
def test_what_cannot_be_used_is_one_message_and_nothing_written(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], model: str, run: str, said: str
) -> None:
    status, out, err = call(capsys, "init", folder / model, folder / run, "--out", tmp_path / "robot.toml")
    assert status == 2 and out == "" and said in err and len(err.strip().splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_is_not_there(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ("init", folder / "arm.xml", folder / "log.csv", "--out", tmp_path / "new" / "robot.toml")
    status, _, err = call(capsys, *words)
    assert status == 2 and "folder not found" in err and list(tmp_path.iterdir()) == []


def test_a_data_set_of_lerobot(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = pd.read_csv(folder / "log.csv")
    lists = {
        "action": [f"command.{j}" for j in JOINTS],
        "observation.state": [f"{g}.{j}" for g in ("position", "velocity") for j in JOINTS],
    }
    heard = {"action": [f"{j}.pos" for j in JOINTS]}
    heard["observation.state"] = [f"{j}.{g}" for g in ("pos", "vel") for j in JOINTS]
    columns = {name: list(table[members].to_numpy()) for name, members in lists.items()}
    data = tmp_path / "set" / "data" / "chunk-000"
    data.mkdir(parents=True)
    pd.DataFrame({**columns, "timestamp": table["t"]}).to_parquet(data / "file-000.parquet")
    (tmp_path / "set" / "meta").mkdir()
    features = {name: {"names": names} for name, names in heard.items()}
    (tmp_path / "set" / "meta" / "info.json").write_text(json.dumps({"features": features}))
    out = tmp_path / "arm.toml"
    status, said, guesses = call(capsys, "init", folder / "arm.xml", data / "file-000.parquet", "--out", out)
    assert status == 0 and said.rstrip().splitlines()[-2] == "usable"
    assert "note: list columns are split into their elements" in guesses
    assert '"command.elbow" = "action.elbow.pos"' in out.read_text()
    assert '"velocity.elbow" = "observation.state.elbow.vel"' in out.read_text()
    assert call(capsys, "check", "--robot", out, data / "file-000.parquet")[0] == 0
