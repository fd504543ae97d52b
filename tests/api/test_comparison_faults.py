"""What `compare` refuses from Python, and that it says what is wrong before anything is fitted."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from oracles.rover_log import ROBOT, rover_run, write_run

import residual_mpc as rm
import residual_mpc.api.comparison


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """rover.toml and four runs of 8 s."""
    place = tmp_path_factory.mktemp("rover")
    (place / "rover.toml").write_text(ROBOT)
    for k in range(4):
        write_run(rover_run(f"r{k}", {}, 8.0, seed=k), place)
    return place


@pytest.fixture(scope="module")
def robot(folder: Path) -> rm.NominalRobot:
    return rm.load_robot(folder / "rover.toml")


@pytest.fixture(autouse=True)
def nothing_is_fitted(monkeypatch: pytest.MonkeyPatch) -> None:
    def fitted(*arguments: object) -> None:
        raise AssertionError("the runs should have been refused before")

    monkeypatch.setattr(residual_mpc.api.comparison, "run_comparison", fitted)


def runs(robot: rm.NominalRobot, folder: Path, *names: str) -> rm.Runs:
    return rm.read_runs(robot, [folder / f"{name}.csv" for name in names])


def test_a_run_in_both_sets(robot: rm.NominalRobot, folder: Path, tmp_path: Path) -> None:
    before = runs(robot, folder, "r0", "r1")
    with pytest.raises(rm.BadInput, match=r"r1: the same run is in `before` and in `after`"):
        rm.compare(robot, before, runs(robot, folder, "r1", "r2"))
    (tmp_path / "copy.csv").write_bytes((folder / "r0.csv").read_bytes())
    with pytest.raises(rm.BadInput, match=r"copy and r0: the same run"):
        rm.compare(robot, before, runs(robot, tmp_path, "copy"))


@pytest.mark.parametrize("side", ["`before`", "`after`"])
def test_a_set_without_runs(robot: rm.NominalRobot, folder: Path, side: str) -> None:
    some = runs(robot, folder, "r0", "r1")
    none = replace(some, runs=(), models=(), paths=())
    sets = (none, some) if side == "`before`" else (some, none)
    with pytest.raises(rm.BadInput, match=f"{side}: must name at least one run"):
        rm.compare(robot, *sets)


@pytest.mark.parametrize("side", ["`before`", "`after`"])
def test_one_run_that_is_too_short(robot: rm.NominalRobot, folder: Path, side: str) -> None:
    some = runs(robot, folder, "r0", "r1")
    run = some[0]
    short = replace(run, t=run.t[:11], columns={k: v[:11] for k, v in run.columns.items()})
    one = replace(some, runs=(short,), models=some.models[:1])
    others = runs(robot, folder, "r2", "r3")
    with pytest.raises(rm.BadInput, match=rf"{side}, r0: one run of 0.5 s .* at least 2 stretches of 3 s"):
        rm.compare(robot, *((one, others) if side == "`before`" else (others, one)))


def test_a_stretch_is_no_shorter_than_the_horizon(robot: rm.NominalRobot, folder: Path) -> None:
    with pytest.raises(rm.BadInput, match=r"at least 2 stretches of 5 s"):
        rm.compare(robot, runs(robot, folder, "r0"), runs(robot, folder, "r1", "r2"), horizon=5.0)


@pytest.mark.parametrize("option", ["only", "without"])
def test_an_effect_that_nobody_knows(robot: rm.NominalRobot, folder: Path, option: str) -> None:
    sets = (runs(robot, folder, "r0", "r1"), runs(robot, folder, "r2", "r3"))
    chosen: dict[str, Any] = {option: ("track_with",)}
    with pytest.raises(rm.BadInput, match=rf"`{option}`: unknown effect 'track_with'. Did you mean 'track_width'"):
        rm.compare(robot, *sets, **chosen)


def test_an_effect_that_the_robot_cannot_have(robot: rm.NominalRobot, folder: Path) -> None:
    sets = (runs(robot, folder, "r0", "r1"), runs(robot, folder, "r2", "r3"))
    with pytest.raises(rm.BadInput, match=r"`only`: rover cannot have the effect 'payload'"):
        rm.compare(robot, *sets, only="payload")


def test_runs_that_the_audit_forbids(robot: rm.NominalRobot, folder: Path, tmp_path: Path) -> None:
    run = rover_run("degrees", {}, 8.0, seed=9)
    turned = {**run.columns, "pose.theta": np.degrees(run.columns["pose.theta"])}
    write_run(replace(run, columns=turned), tmp_path)
    with pytest.raises(rm.BadInput, match=r"pose\.theta"):
        rm.compare(robot, runs(robot, folder, "r0", "r1"), runs(robot, tmp_path, "degrees"))
