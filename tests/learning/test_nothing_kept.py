"""Where learning does not help, nothing of it is kept: the model is the one without it, and every answer says so."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from oracles.rover_log import ROBOT, rover_run, write_run

import residual_mpc as rm
from residual_mpc.learning.batch import training
from residual_mpc.learning.batch.checkpoint import Checkpoint

FAULTS = {"actuator_lag": {"time_constant": 0.15}, "track_width": {"scale": 1.15}}


@pytest.fixture(scope="module")
def rover(tmp_path_factory: pytest.TempPathFactory) -> tuple[Any, Any]:
    here = tmp_path_factory.mktemp("rover")
    (here / "rover.toml").write_text(ROBOT)
    files = [write_run(rover_run(f"r{k}", FAULTS, 12.0, seed=k), here) for k in range(4)]
    robot = rm.load_robot(here / "rover.toml")
    return robot, rm.read_runs(robot, files)


def passes_are(monkeypatch: pytest.MonkeyPatch, change: Callable[[Checkpoint], Checkpoint]) -> None:
    """Let the passes over the data end otherwise than they do."""
    before = training._updates
    monkeypatch.setattr(training, "_updates", lambda *a: change(before(*a)))


def test_of_an_untrained_network_nothing_is_kept(
    rover: tuple[Any, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        passes_are(patch, lambda c: replace(c, pass_gap=np.full_like(c.pass_gap, np.inf)))
        found = rm.learn(*rover, case="sim-to-dyn", passes=1, out=tmp_path / "d1")
    assert found.document["chosen_pass"] == 0 and found.document["kept"] is False
    assert all(g["after"] == g["before"] for g in (found.gap, *found.gap["channels"].values()))
    said = str(found)
    assert "nothing that was learned was kept" in said and "converged" not in said and "try more passes" in said
    assert "Nothing that was learned was kept" in (tmp_path / "d1" / "report.html").read_text()
    model = json.loads((tmp_path / "d1" / "model.json").read_text())
    assert model["residual"] is None and model["last_residual"] is None
    robot, runs = rover
    assert not any(n.startswith("theta.") for n in rm.augment(robot, tmp_path / "d1" / "model.json").parameters)
    assert rm.augment(robot, None, found).augmented.residual is None, "what kept nothing is given like a network"
    again = rm.learn(robot, runs, warm_start=tmp_path / "d1" / "model.json", passes=1)
    assert "the previous case kept nothing" in str(again) and again.document["condition"] is None


def test_what_is_worse_on_held_out_runs_is_not_kept(rover: tuple[Any, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    def spoil(c: Checkpoint) -> Checkpoint:
        wild = np.random.default_rng(0).standard_normal(c.pass_theta.shape)
        return replace(c, pass_gap=np.zeros_like(c.pass_gap), pass_theta=wild)

    monkeypatch.setattr(training, "without_harmful_outputs", lambda evaluation, form, learned, windows: (learned, ()))
    passes_are(monkeypatch, spoil)
    found = rm.learn(*rover, passes=1)
    assert found.document["chosen_pass"] == 1 and found.document["kept"] is False and found.model["residual"] is None
    assert found.gap["after"] == found.gap["before"] and found.document["worse_on_held_out"]
    assert "nothing that was learned was kept: the model predicts held-out runs better without it" in str(found)


def test_the_first_case_begins_from_nothing(rover: tuple[Any, Any], tmp_path: Path) -> None:
    (tmp_path / "d1.json").write_text("{}")
    with pytest.raises(rm.BadInput, match="starts without an earlier residual and takes no `warm_start`"):
        rm.learn(*rover, case="sim-to-dyn", warm_start=tmp_path / "d1.json")
