"""Runs stamped in nanoseconds since 1970: everything that is printed counts from each run's start."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from oracles.rover_log import ROBOT, rover_run, write_run

from residual_mpc.cli.main import main

EPOCH = 1_760_000_000_123_456_789  # ns


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    there = tmp_path_factory.mktemp("rover")
    (there / "rover.toml").write_text(ROBOT)
    write_run(rover_run("one", {}, 8.0, seed=1), there)
    table = pd.read_csv(there / "one.csv")
    stamps = EPOCH + np.rint(1e9 * (table["t"] - table["t"][0])).astype(np.int64)
    (there / "ns").mkdir()
    table.assign(t=stamps).to_csv(there / "ns" / "one.csv", index=False)
    cut = table.assign(t=stamps)[(table["t"] < 3.0) | (table["t"] > 5.0)]
    cut.to_csv(there / "ns" / "cut.csv", index=False)
    return there


def call(capsys: pytest.CaptureFixture[str], folder: Path, command: str, *words: str | Path) -> str:
    with pytest.raises(SystemExit) as end:
        main([command, "--robot", str(folder / "rover.toml"), *map(str, words)])
    assert not end.value.code
    return str(capsys.readouterr().out)


def test_the_gap_is_that_of_stamps_in_seconds(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    seconds, nanoseconds = (
        json.loads(call(capsys, folder, "gap", path, "--json"))
        for path in (folder / "one.csv", folder / "ns" / "one.csv")
    )
    assert nanoseconds["windows"] == seconds["windows"] == 8
    assert nanoseconds["nominal"] == pytest.approx(seconds["nominal"], rel=1e-3)


def test_held_out_blocks_count_from_the_start(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    kept = folder / "diagnosis.json"
    kept.write_text(json.dumps({"held_out": [{"run": "one", "from": 2.0, "to": 5.0}]}))
    out = call(capsys, folder, "gap", folder / "ns" / "one.csv", "--held-out-of", kept, "--json")
    assert json.loads(out)["windows"] == 3


def test_check_counts_from_the_start(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = call(capsys, folder, "check", folder / "ns" / "cut.csv")
    assert "nanoseconds" in out and "from t = 2.95 s" in out
    (run,) = json.loads(call(capsys, folder, "check", folder / "ns" / "cut.csv", "--json"))["runs"]
    described: dict[str, Any] = run
    assert described["start"] == pytest.approx(1e-9 * EPOCH) and described["seconds"] < 8.1
