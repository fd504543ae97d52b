"""The demo draws, seals, diagnoses, opens and compares; what it says of an answer follows the benchmark's rule."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from blind.answers import answer

from residual_mpc.demo import comparison, draw, draw_demo_robot, drive, open_seal, tracking_lines
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


def test_the_demo_robot_is_sealed_beside_what_its_user_has(tmp_path: Path) -> None:
    robot, case = draw_demo_robot(7, tmp_path)
    assert {p.suffix for p in case.folder.iterdir()} == {".toml", ".csv"}
    assert case.sealed.parent != case.folder and case.folder not in case.sealed.parents
    told = (case.folder / "robot.toml").read_text()
    hidden = open_seal(case)
    numbers = [f"{value:.3g}" for effect in hidden.effects for value in effect.parameters.values()]
    assert len(hidden.effects) == 3 and not any(number in told for number in numbers)
    assert "TurtleBot" in robot.describe


@pytest.mark.slow
def test_the_true_model_drives_the_demo_robot_better(tmp_path: Path) -> None:
    """The plant of the closed loop is the robot of the runs: what is hidden in these corrects the controller."""
    robot, case = draw_demo_robot(7, tmp_path)
    values = [
        {"effect": e.effect, "target": e.target, "parameter": k, "value": v}
        for e in open_seal(case).effects
        for k, v in e.parameters.items()
    ]
    model = tmp_path / "model.json"
    model.write_text(json.dumps({"schema": "residual-mpc/model/1", "robot": "turtlebot", "values": values}))
    nominal, corrected, _ = drive(robot, case, model, tmp_path / "drive")
    assert float(corrected.split()[1]) < 0.3 * float(nominal.split()[1])


def test_what_is_said_of_the_driving() -> None:
    assert tracking_lines(0.02, 0.005)[-1] == "The corrected model makes the error 75% smaller."
    assert tracking_lines(0.02, 0.03)[-1] == "The corrected model makes the error 50% larger."
    assert tracking_lines(None, 0.005) == ["nominal:   lost its path", "corrected: 5.0 mm off its reference"]
