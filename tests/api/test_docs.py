"""The Python in docs/python.md runs as it stands."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from oracles.rover_log import ROBOT, rover_run, write_run

PAGE = Path(__file__).resolve().parents[2] / "docs" / "python.md"


def test_the_page_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "robot.toml").write_text(ROBOT)
    (tmp_path / "runs").mkdir()
    for k in range(3):
        write_run(rover_run(f"r{k}", {"actuator_lag": {"time_constant": 0.1}}, seconds=10.0, seed=k), tmp_path / "runs")
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.S)
    assert len(blocks) == 2
    space: dict[str, Any] = {}
    exec("\n".join(blocks), space)
    assert space["diagnosis"].verdict == "effects"
    assert {p.name for p in Path("out").iterdir()} >= {"diagnosis.json", "model.json", "report.html"}
    assert space["opti"].ng == 20 * len(space["model"].states)
