"""A push in one set is no change of the robot."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from oracles.rover_log import ROBOT, rover_run, write_run

import residual_mpc as rm
from residual_mpc.logs.run import Run

SOME = ("track_width", "wheel_radius", "actuator_lag", "command_delay", "lateral_slip")


def pushed(run: Run) -> Run:
    """For 1.5 s the robot does something else than its log says."""
    amid = (run.t >= 7.0) & (run.t < 8.5)
    columns = dict(run.columns)
    columns["command.left"] = np.where(amid, columns["command.left"] - 6.0, columns["command.left"])
    columns["command.right"] = np.where(amid, columns["command.right"] + 6.0, columns["command.right"])
    return Run(run.name, run.t, columns)


def test_the_change_of_all_else_is_named_and_so_is_the_stretch(tmp_path: Path) -> None:
    (tmp_path / "robot.toml").write_text(ROBOT)
    for side, track in (("before", 1.0), ("after", 1.1)):
        (tmp_path / side).mkdir()
        for k in range(5):
            faults = {"track_width": {"scale": track}}
            run = rover_run(f"run{k}", faults, 16.0, seed=k + 10 * (side == "after"))
            write_run(pushed(run) if (side, k) == ("after", 1) else run, tmp_path / side)
    robot = rm.load_robot(tmp_path / "robot.toml")
    sets = [rm.read_runs(robot, sorted((tmp_path / side).glob("*.csv"))) for side in ("before", "after")]
    found = rm.compare(robot, *sets, only=SOME)
    assert found.verdict == "changed"
    (change,) = found.changes
    assert change["effect"] == "track_width" and change["probability"] > 0.9
    low, high = change["parameters"]["scale"]["change"]["ci95"]
    assert low < 1.1 < high
    (note,) = (n for n in found.document["notes"] if "unlike everything else" in n)
    assert note.startswith("after/run1 from 7 to")
