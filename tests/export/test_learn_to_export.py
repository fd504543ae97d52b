"""From a log to files for others, by the commands alone: what `learn` writes, `export` takes, and both say the same."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from oracles.rover_log import ROBOT, rover_run, write_run

from plants.diff_drive import DiffDrive
from residual_mpc.cli.main import main
from residual_mpc.learning.forms.residual_robot import residual_robot
from residual_mpc.learning.network.written import residual_in
from residual_mpc.models.model_file import model_in, read_written
from residual_mpc.models.protocol import Drive
from residual_mpc.models.settings import assemble

FAULTS = {"actuator_lag": {"time_constant": 0.15}, "track_width": {"scale": 1.15}}
LAG = [{"effect": "actuator_lag", "target": None, "parameter": "time_constant", "value": 0.14}]


def call(*arguments: object) -> None:
    with pytest.raises(SystemExit) as end:
        main([str(a) for a in arguments])
    assert not end.value.code


@pytest.fixture(scope="module")
def learned(tmp_path_factory) -> Path:
    """model.json of a rover with a lag that is known and a track that is not, its robot file in another folder."""
    here = tmp_path_factory.mktemp("rover")
    (here / "robots").mkdir()
    (here / "robots" / "rover.toml").write_text(ROBOT)
    files = [write_run(rover_run(f"r{k}", FAULTS, 14.0, seed=k), here) for k in range(5)]
    known = here / "known.json"
    known.write_text(json.dumps({"schema": "residual-mpc/model/1", "robot": "rover", "values": LAG}))
    robot = here / "robots" / "rover.toml"
    call("learn", "--robot", robot, *files, "--on", known, "--out", here / "out" / "learned", "--passes", 1)
    return here / "out" / "learned" / "model.json"


@pytest.mark.parametrize("to", ["casadi", "c", pytest.param("jax", marks=pytest.mark.slow)])
def test_a_learned_model_is_exported_without_naming_its_robot(to, learned, tmp_path, capsys):
    call("export", learned, "--to", to, "--out", tmp_path, "--json")
    said = json.loads(capsys.readouterr().out)
    assert said["largest_difference"]["largest"] < 1e-8
    assert said["robot"] == "rover" and said["dt"] == residual_in(read_written(learned)).step


def test_the_exported_step_drives_as_the_replay_does_inside_the_limit_and_beyond(learned, tmp_path, capsys):
    call("export", learned, "--to", "casadi", "--out", tmp_path, "--json")
    said = json.loads(capsys.readouterr().out)
    f = ca.Function.load(str(tmp_path / "step.casadi"))
    p = np.array([v["value"] for v in said["parameters"]])
    names = [s["name"] for s in said["states"]]
    r = residual_in(read_written(learned))
    values = model_in(read_written(learned))[1]
    rover = DiffDrive("rover", 0.033, 0.16)
    settings = assemble([values], {k.effect: rover.slots(k.effect) for k in values})
    steps, lead = 30, 20  # at rest before, where both have nothing to remember
    for share in (0.5, 2.0):  # of the limit on commands
        u = np.random.default_rng(0).uniform(-1, 1, (1, lead + steps, 2)) * share * r.limit * r.input_scale[3:]
        u[:, :lead] = 0.0
        drive = Drive(r.step, lead, u, None, np.zeros(1))
        start = {c: np.zeros(1) for c in ("pose.x", "pose.y", "pose.theta")}
        nodes = residual_robot(rover, r).replay(start, drive, settings, tuple(start))
        without = rover.replay(start, drive, settings, tuple(start))
        x, apart, matters = np.array(said["rest"]), 0.0, 0.0
        for k in range(lead):
            x = np.array(f(x, u[0, k], p)).ravel()
        x[[names.index(c) for c in start]] = 0.0
        for k in range(steps):
            x = np.array(f(x, u[0, lead + k], p)).ravel()
            apart = max(apart, *(abs(x[names.index(c)] - nodes[c][0, k + 1]) for c in start))
            matters = max(matters, *(abs(without[c][0, k + 1] - nodes[c][0, k + 1]) for c in start))
        assert apart < 1e-9 and matters > 1e-2, (share, apart, matters)


def test_a_folder_that_moves_with_its_robot_still_finds_it(learned, tmp_path, capsys):
    shutil.copytree(learned.parents[2], tmp_path / "moved")
    model = tmp_path / "moved" / learned.relative_to(learned.parents[2])
    assert not os.path.isabs(json.loads(model.read_text())["robot_file"])
    call("export", model, "--to", "casadi", "--json")
    assert json.loads(capsys.readouterr().out)["robot"] == "rover"
