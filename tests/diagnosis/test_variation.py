"""An effect whose size differs from run to run, or that begins or ends in mid-run, says so; a steady one does not."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from oracles.rover_log import ROBOT, rover_run, write_run

import residual_mpc as rm

ONLY = ("command_delay", "track_width", "actuator_gain")


def diagnosed(folder: Path, effect: str, parameter: str, sizes: list[float]) -> dict[str, Any]:
    """The only named effect of a rover that has it in these sizes, run by run."""
    (folder / "robot.toml").write_text(ROBOT)
    robot = rm.load_robot(folder / "robot.toml")
    runs = [rover_run(f"run{k}", {effect: {parameter: x}}, seconds=12.0, seed=k) for k, x in enumerate(sizes)]
    found = rm.diagnose(robot, rm.read_runs(robot, [write_run(r, folder) for r in runs]), only=ONLY)
    (cause,) = found.explanation
    assert cause["effect"] == effect
    return cause


def test_sizes_of_runs_are_stated_where_they_differ(tmp_path: Path) -> None:
    sizes = [1.1, 1.4, 1.2, 1.35]
    cause = diagnosed(tmp_path, "track_width", "scale", sizes)
    assert list(cause["by_run"]) == [f"run{k}" for k in range(4)] and "since" not in cause
    np.testing.assert_allclose(list(cause["by_run"].values()), sizes, atol=0.03)


def test_a_steady_effect_has_no_sizes_of_runs(tmp_path: Path) -> None:
    cause = diagnosed(tmp_path, "command_delay", "delay", [0.1] * 4)
    assert not {"by_run", "since", "until"} & set(cause)


@pytest.mark.parametrize(("sizes", "key", "run"), [
    ([1.0, 1.0, 0.7, 0.7], "since", "run2"),
    ([0.7, 0.7, 0.7, 1.0], "until", "run3"),
])  # fmt: skip
def test_an_effect_that_begins_or_ends_says_when(tmp_path: Path, sizes: list[float], key: str, run: str) -> None:
    cause = diagnosed(tmp_path, "actuator_gain", "gain", sizes)
    assert set(cause) & {"by_run", "since", "until"} == {key}
    assert cause[key]["run"] == run and cause[key]["t"] == pytest.approx(0.0, abs=1.0)
