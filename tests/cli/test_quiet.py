"""What a library under the hood has to say reaches neither the user's terminal nor their folder."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from oracles.arms import wheel_xml

DIVERGES = '<general name="hub" joint="hub" gainprm="1e7" biastype="affine" biasprm="0 -1e7 3000"/>'
ALONE = """
from pathlib import Path
import numpy as np
from joblib import Parallel, delayed
from plants.mujoco_robot import build
from residual_mpc.models.protocol import Drive
from residual_mpc.models.robot_file import read_robot_file
from residual_mpc.models.settings import Settings

def move(stepped):
    robot = build(read_robot_file("robot.toml"))
    start = {"position.hub": np.full(1, 0.3), "velocity.hub": np.zeros(1)}
    wanted = ("position.hub", "output.hub") if stepped else ("position.hub",)
    robot.replay(start, Drive(0.002, 0, np.zeros((1, 200, 1)), None, np.zeros(1)), Settings(1), wanted)
    simulator = robot.simulator(Settings(1), 2, 0.02)
    simulator.reset({"position.hub": 0.3})
    for _ in range(20):
        simulator.step(np.zeros(1))

Parallel(n_jobs=2)(delayed(move)(stepped) for stepped in (True, False))
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A robot whose simulation leaves all bounds within a few steps, and a run."""
    (tmp_path / "robot.xml").write_text(wheel_xml(DIVERGES).replace("implicitfast", "Euler"))
    (tmp_path / "robot.toml").write_text('plant = "mujoco"\nmodel = "robot.xml"\n')
    t = np.arange(0.0, 12.0, 0.01)
    noise = 1e-4 * np.random.default_rng(0).standard_normal(len(t))
    turn = 0.5 * np.sin(2.5 * t)
    table = pd.DataFrame({"t": t, "command.hub": turn, "position.hub": 0.9 * turn + noise})
    table.to_csv(tmp_path / "run.csv", index=False)
    return tmp_path


def call(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, *words], cwd=folder, capture_output=True, text=True, check=False)


def test_a_model_that_diverges_leaves_no_file_and_no_warning(folder: Path) -> None:
    before = sorted(folder.iterdir())
    done = call(folder, "-m", "residual_mpc.cli.main", "gap", "--robot", "robot.toml", "run.csv", "--json")
    assert done.returncode == 0, done.stderr
    assert sorted(folder.iterdir()) == before
    assert "WARNING" not in done.stderr and "QACC" not in done.stderr
    assert json.loads(done.stdout)["nominal"] > 10.0  # what ran away does not pass for what stood still


def test_worker_processes_are_as_quiet(folder: Path) -> None:
    before = sorted(folder.iterdir())
    done = call(folder, "-W", "ignore", "-c", ALONE)
    assert done.returncode == 0, done.stderr
    assert sorted(folder.iterdir()) == before and done.stderr == "" == done.stdout


def test_pybullet_does_not_introduce_itself(tmp_path: Path) -> None:
    pytest.importorskip("pybullet")
    done = call(tmp_path, "-c", "from plants.pybullet_import import import_pybullet; import_pybullet().connect")
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
