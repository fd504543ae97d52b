"""The demo draws, seals, diagnoses, opens and compares; what it says of an answer follows the benchmark's rule."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from blind.answers import answer

from residual_mpc.demo import comparison, draw, open_seal
from residual_mpc.errors import BadInput


def written(folder: Path, verdict: str, *named: tuple[str, str | None]) -> Path:
    """A diagnosis.json that names these."""
    parts: list[dict[str, Any]] = [{"effect": e, "target": t, "probability": 0.9, "parameters": {}} for e, t in named]
    path = folder / "diagnosis.json"
    path.write_text(json.dumps({"verdict": verdict, "explanation": parts, "candidates": [], "confounded": []}))
    return path


def test_a_right_answer_is_called_right(tmp_path: Path) -> None:
    found = written(tmp_path, "effects", ("command_delay", "left"))
    lines = comparison(answer(("command_delay", "left", {"delay": 0.08})), found)
    assert lines[0] == "hidden: command_delay [left]: delay 0.08"
    assert lines[-1] == "The diagnosis is right: command_delay [left]."


def test_a_wrong_place_is_said(tmp_path: Path) -> None:
    found = written(tmp_path, "effects", ("command_delay", "right"))
    assert "but at another place" in comparison(answer(("command_delay", "left")), found)[-1]


def test_a_wrong_answer_is_called_wrong(tmp_path: Path) -> None:
    found = written(tmp_path, "effects", ("slope", None))
    assert comparison(answer(("command_delay", "left")), found)[-1] == "The diagnosis is wrong: it says slope."


def test_a_robot_without_a_gap(tmp_path: Path) -> None:
    lines = comparison(answer(), written(tmp_path, "no_gap"))
    assert lines == ["hidden: nothing", "The diagnosis is right: no_gap."]


def test_a_seed_of_the_tests_is_refused() -> None:
    with pytest.raises(BadInput, match="seed"):
        draw("wheeled", "none", 100_000, None)


def test_the_seal_notices_a_changed_run(tmp_path: Path) -> None:
    case = draw("wheeled", "none", 3, tmp_path)
    assert open_seal(case).effects == ()
    run = next(p for p in case.folder.iterdir() if p.name.startswith("run"))
    run.write_bytes(run.read_bytes() + b"\n")
    with pytest.raises(BadInput, match="changed"):
        open_seal(case)
