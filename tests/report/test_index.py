"""The page for a folder of results: every result with its verdict, gap and links that exist; nothing else."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from residual_mpc.cli.main import main

DIAGNOSIS: dict[str, Any] = {
    "schema": "residual-mpc/diagnosis/1", "robot": "rover <1>", "verdict": "effects",
    "verdict_sentence": "The commands arrive 80 ms late.", "explanation": [{"effect": "command_delay"}],
    "gap": {"before": 0.2, "after": 0.05},
}  # fmt: skip
COMPARISON: dict[str, Any] = {
    "schema": "residual-mpc/comparison/1", "robot": "rover", "verdict": "same", "verdict_sentence": "No change found.",
    "changes": [], "gap": {"before": 0.1, "after": 0.11, "after_explained": 0.11},
}  # fmt: skip
CONTROLLERS = {"nominal": {"tracking_rmse": 0.04}, "augmented": {"tracking_rmse": 0.01}}
RUN = {"scenario": "figure_eight", "controllers": CONTROLLERS}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    results = {"a b/diagnosis.json": DIAGNOSIS, "a b/report.html": {}, "sets/june/comparison.json": COMPARISON,
               "drive/result.json": RUN, "other/diagnosis.json": {"a": 1}}  # fmt: skip
    for name, content in results.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(content))
    (tmp_path / "other/comparison.json").write_text("{")
    return tmp_path


def call(*words: str) -> int:
    with pytest.raises(SystemExit) as end:
        main(["index", *words])
    assert isinstance(end.value.code, int)
    return end.value.code


def test_every_result_and_nothing_else(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert call(str(folder), "--json") == 0
    found = json.loads(capsys.readouterr().out)["index"]["results"]
    assert {(e["folder"], e["kind"], e["title"]) for e in found} == {
        ("a b", "diagnosis", "Explained"), ("sets/june", "comparison", "No change found"),
        ("drive", "closed loop", "Better"),
    }  # fmt: skip
    bars = {e["folder"]: (e["bar"]["before"], e["bar"]["after"], e["bar"]["less"].replace("\xa0", " ")) for e in found}
    assert bars["a b"] == ("0.2", "0.05", "75 % less")
    assert bars["drive"][2] == "75 % less" and bars["sets/june"][1] == ""


def test_the_page_stands_alone_and_its_links_lead_somewhere(folder: Path) -> None:
    from urllib.parse import unquote

    assert call(str(folder)) == 0
    page = (folder / "index.html").read_text()
    links = re.findall(r'href="([^"#]+)"', page)
    assert "a%20b/report.html" in links
    assert all((folder / unquote(link)).is_file() for link in links)
    assert "rover &lt;1&gt;" in page and "<script" not in page and "http" not in page.replace("http-equiv", "")


def test_an_empty_folder_has_a_page_too(tmp_path: Path) -> None:
    assert call(str(tmp_path)) == 0
    assert "No results yet" in (tmp_path / "index.html").read_text()


def test_a_file_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "x").write_text("")
    assert call(str(tmp_path / "x")) == 2
    assert "folder" in capsys.readouterr().err
