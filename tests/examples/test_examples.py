"""The scripts of the guide's examples, from the data that they make to the controller."""

from __future__ import annotations

import os
import runpy
import sys
from pathlib import Path
from typing import Any

import pytest

EXAMPLES = Path(__file__).resolve().parents[2] / "docs" / "examples"


@pytest.fixture(autouse=True)
def command_on_path(monkeypatch: pytest.MonkeyPatch) -> None:
    """The command of this environment, which `make test` does not activate."""
    monkeypatch.setenv("PATH", os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]]))


def run(script: str, folder: Path) -> tuple[dict[str, Any], Any]:
    """What an example finds, and what it hid: effect -> value."""
    space = runpy.run_path(str(EXAMPLES / script))
    return space["main"](folder), space["HIDDEN"]


def found(result: dict[str, Any]) -> dict[str, float]:
    """Effect -> its first parameter."""
    named = result["diagnosis"].explanation
    return {e["effect"]: next(iter(e["parameters"].values()))["value"] for e in named}


def share_left(result: dict[str, Any]) -> float:
    """Tracking error of the augmented controller, as a share of the nominal one's."""
    each = {name: c["tracking_rmse"] for name, c in result["controllers"].items()}
    assert {c["failures"] for c in result["controllers"].values()} == {0}
    return each["augmented"] / each["nominal"]


@pytest.mark.slow
def test_a_wheeled_robot_from_a_rosbag(tmp_path: Path) -> None:
    result, hidden = run("wheeled_rosbag.py", tmp_path)
    assert found(result) == pytest.approx(hidden, rel=0.05)
    assert result["diagnosis"].verdict == "effects"
    assert share_left(result) < 0.4


@pytest.mark.slow
def test_a_position_controlled_arm_from_mcap(tmp_path: Path) -> None:
    result, hidden = run("position_arm_mcap.py", tmp_path)
    assert found(result) == pytest.approx(hidden, rel=0.1)
    assert share_left(result) < 0.3


@pytest.mark.slow
def test_a_torque_controlled_arm_from_hdf5(tmp_path: Path) -> None:
    result, hidden = run("torque_arm_hdf5.py", tmp_path)
    assert found(result) == pytest.approx(hidden, rel=0.1)
    assert share_left(result) < 0.3


@pytest.mark.slow
def test_a_hobby_arm_from_lerobot(tmp_path: Path) -> None:
    result, hidden = run("lerobot_arm.py", tmp_path)
    assert found(result) == pytest.approx(hidden, rel=0.1)
    assert share_left(result) < 0.3
