"""A diagnosis that begins with the effects of an earlier one: it keeps what is right and drops what is not."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from oracles.rover_log import ROBOT, rover_run, write_run

import residual_mpc as rm
from residual_mpc.cli.main import main
from residual_mpc.errors import BadInput

LATE = {"command_delay": {"delay": 0.08}}
ONLY = ("command_delay", "actuator_lag", "dead_zone", "track_width")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("rover")
    (folder / "robot.toml").write_text(ROBOT)
    for k in range(2):
        write_run(rover_run(f"run{k}", LATE, seconds=16.0, seed=k), folder)
    return folder


def model_of(folder: Path, name: str, robot: str = "rover", **values: float) -> Path:
    """A model.json with effect__parameter=value."""
    rows = [
        dict(zip(("effect", "parameter"), k.split("__"), strict=True), target=None, value=v) for k, v in values.items()
    ]
    path = folder / name
    path.write_text(json.dumps({"schema": "residual-mpc/model/1", "robot": robot, "values": rows}))
    return path


def diagnosed(folder: Path, start: Any = None, without: tuple[str, ...] = ()) -> tuple[rm.Diagnosis, list[str]]:
    robot = rm.load_robot(folder / "robot.toml")
    runs = rm.read_runs(robot, [folder / "run0.csv", folder / "run1.csv"])
    said: list[str] = []
    found = rm.diagnose(
        robot, runs, only=ONLY, without=without, start=start, progress=lambda stage, done: said.append(stage)
    )
    return found, said


def test_the_search_begins_with_the_earlier_effects(folder: Path) -> None:
    first, said = diagnosed(folder)
    assert any("0 effects so far" in stage for stage in said)
    again, said = diagnosed(folder, first)
    assert not any("0 effects so far" in stage for stage in said) and any("1 effect so far" in stage for stage in said)
    for found in (first, again):
        (cause,) = found.explanation
        assert cause["effect"] == "command_delay"
        low, high = cause["parameters"]["delay"]["ci95"]
        assert low <= 0.08 <= high
    assert "--from earlier/diagnosis.json" in again.document["command"]


def test_wrong_effects_of_the_start_are_dropped(folder: Path) -> None:
    start = model_of(folder, "wrong.json", track_width__scale=1.05, dead_zone__width=0.4)
    found, said = diagnosed(folder, start)
    assert not any("0 effects so far" in stage for stage in said)
    assert [e["effect"] for e in found.explanation] == ["command_delay"]


def test_effects_that_are_excluded_are_not_begun_with(folder: Path) -> None:
    start = model_of(folder, "delay.json", command_delay__delay=0.08)
    found, said = diagnosed(folder, start, without=("command_delay",))
    assert any("0 effects so far" in stage for stage in said)
    assert "command_delay" not in {e["effect"] for e in found.explanation}


@pytest.mark.parametrize(
    ("values", "robot", "said"),
    [
        ({"command_delay__delay": 0.08}, "digger", "must be of 'rover', got one of 'digger'"),
        ({"joint_compliance__stiffness": 9.0}, "rover", "joint_compliance"),
    ],
)
def test_a_start_of_another_robot_is_refused(
    folder: Path, capsys: pytest.CaptureFixture[str], values: dict[str, float], robot: str, said: str
) -> None:
    start = model_of(folder, "other.json", robot, **values)
    with pytest.raises(BadInput, match=said):
        diagnosed(folder, start)
    words = ["diagnose", "--robot", str(folder / "robot.toml"), str(folder / "run0.csv"), "--out", str(folder / "out")]
    with pytest.raises(SystemExit) as end:
        main([*words, "--from", str(start)])
    assert end.value.code == 2 and not (folder / "out" / "diagnosis.json").exists()
    err = capsys.readouterr().err
    assert said in err and "Traceback" not in err
