"""UR5e, Panda, SO-101 and a rover of four wheels: from the published model without its meshes, and a log with other
names, to the hidden effects without an edit by hand."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from published.logs import CASES, Case

from residual_mpc.models.load import load_robot
from residual_mpc.models.robot_file import read_robot_file


def call(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    done = subprocess.run(
        [sys.executable, "-m", "residual_mpc.cli.main", *words], cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done


def drafted(folder: Path, case: Case) -> str:
    """init on the model and the logs; the runs to go on with."""
    name, text = case.model
    (folder / name).write_text(text)
    (folder / "runs").mkdir()
    case.write(folder / "runs")
    call(folder, "init", name, "runs", *(["--mended", "mended"] if case.mended else []))
    return "mended" if case.mended else "runs"


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.slow) if n != "so101" else n for n in CASES]
)
def test_init_needs_no_edit(tmp_path: Path, name: str) -> None:
    case = CASES[name]
    drafted(tmp_path, case)
    file = read_robot_file(tmp_path / "robot.toml")
    assert len(load_robot(file).actuators) == {"ur5e": 6, "panda": 7, "so101": 6, "rover": 4}[name]
    for actuator in file.actuators.values():  # of a URDF: a servo of a light joint is damped as well
        assert actuator.kind == "position" and 0.02 < actuator.kv / actuator.kp < 0.2


@pytest.mark.slow
@pytest.mark.parametrize("name", list(CASES))
def test_the_drafted_model_has_a_gap_and_does_not_swing(tmp_path: Path, name: str) -> None:
    runs = drafted(tmp_path, CASES[name])
    gap = json.loads(call(tmp_path, "gap", "--robot", "robot.toml", runs, "--json").stdout)
    assert 3 * gap["noise_floor"] < gap["nominal"] < 0.3  # there is something to be found, and nothing swings


@pytest.mark.slow
@pytest.mark.parametrize("name", list(CASES))
def test_hidden_effects_are_named(tmp_path: Path, name: str) -> None:
    case = CASES[name]
    runs = drafted(tmp_path, case)
    call(tmp_path, "diagnose", "--robot", "robot.toml", runs, "--out", "out")
    found = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    named = {e["effect"]: e for e in found["explanation"]}
    if "sensor_delay" in named and "command_delay" not in named and name != "rover":
        named["command_delay"] = named.pop("sensor_delay")  # on an arm whose motors are never off the two are alike
    assert set(case.hidden) <= set(named), named.keys()
    for effect, (target, sizes) in case.hidden.items():
        assert named[effect]["target"] in (target, None)
        for parameter, size in sizes.items():
            assert value_of(named[effect], parameter) == pytest.approx(size, rel=0.15, abs=0.003)
    assert len(named) <= len(case.hidden) + case.besides
    assert found["gap"]["after"] < 0.4 * found["gap"]["before"]


def value_of(member: dict[str, Any], parameter: str) -> float:
    return float(member["parameters"][parameter]["value"])
