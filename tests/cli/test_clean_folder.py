"""Every command writes what it was asked for and nothing else, and repeats no warning."""

from __future__ import annotations

import subprocess
import sys
from collections import Counter
from pathlib import Path

import mujoco
import numpy as np
import pytest
from oracles.arms import arm_xml, wheel_xml
from oracles.rover_log import ROBOT, rover_run, write_run

from plants.mujoco_log import collected_warnings

OWN = """from pathlib import Path
from plants.diff_drive import build
def rover(file):
    return build(file)
"""
SHAPE = '<asset><mesh name="shell" file="shell.stl"/></asset>'
HUB = '<general name="hub" joint="hub" gainprm="1e7" biastype="affine" biasprm="0 -1e7 3000"/>'


def call(folder: Path, *words: str) -> str:
    """What it wrote to stderr."""
    done = subprocess.run(
        [sys.executable, "-m", "residual_mpc.cli.main", *words], cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    for engine in ("WARNING", "QACC", "FutureWarning", "DeprecationWarning", "pybullet build"):
        assert engine not in done.stderr + done.stdout
    said = Counter(line for line in done.stderr.splitlines() if "missing" in line or "held" in line)
    assert not said or max(said.values()) == 1, done.stderr
    return done.stderr


def appeared(folder: Path, before: set[Path]) -> set[str]:
    """Files and folders at the top of the folder that were not there."""
    return {p.relative_to(folder).parts[0] for p in folder.rglob("*") if p not in before}


@pytest.fixture
def rover(tmp_path: Path) -> Path:
    (tmp_path / "mine.py").write_text(OWN)
    (tmp_path / "robot.toml").write_text(ROBOT.replace('"diff_drive"', '"mine:rover"'))
    for k in range(2):
        write_run(rover_run(f"run{k}", {"command_delay": {"delay": 0.08}}, seconds=30.0, seed=k), tmp_path)
    return tmp_path


@pytest.mark.slow
def test_every_command_leaves_a_clean_folder(rover: Path) -> None:
    only, film = ["--only", "command_delay"], ["--video", "seen.webp"]
    runs = ["run0.csv", "run1.csv"]
    before_and_after = ["--before", runs[0], "--after", runs[1]]
    limits = ["--limit", "left=-9:9", "--limit", "right=-9:9"]
    for words, new in (
        (["check", "--robot", "robot.toml", *runs], set()),
        (["gap", "--robot", "robot.toml", *runs], set()),
        (["diagnose", "--robot", "robot.toml", *runs, *only, "--out", "out", *film], {"out", "seen.webp"}),
        (["gap", "--robot", "robot.toml", *runs, "--model", "out/model.json"], set()),
        (["compare", "--robot", "robot.toml", *before_and_after, *only, "--out", "changed"], {"changed"}),
        (["excite", "--robot", "robot.toml", "--seconds", "5", *limits, "--out", "first.csv"], {"first.csv"}),
        (["learn", "--robot", "robot.toml", *runs, "--out", "learned"], {"learned"}),
        (["export", "learned/model.json", "--to", "casadi", "--out", "exported"], {"exported"}),
        (["run"], set()),
    ):  # fmt: skip
        before = set(rover.rglob("*"))
        call(rover, *words)
        assert appeared(rover, before) == new, words


@pytest.mark.slow
def test_the_commands_for_a_model_leave_a_clean_folder(tmp_path: Path) -> None:
    (tmp_path / "arm.xml").write_text(arm_xml().replace("<worldbody>", f"{SHAPE}<worldbody>"))
    t = np.arange(0.0, 12.0, 0.01)
    u = 0.4 * np.sin(t[:, None] * (2.1, 3.3))
    table = np.column_stack([t, u, u + 1e-3 * np.random.default_rng(0).standard_normal(u.shape)])
    header = "t,command.j1,command.j2,position.j1,position.j2"
    np.savetxt(tmp_path / "run.csv", table, delimiter=",", header=header, comments="")
    before = set(tmp_path.rglob("*"))
    assert "shell.stl" in call(tmp_path, "init", "arm.xml", "run.csv")
    assert appeared(tmp_path, before) == {"robot.toml"}
    before = set(tmp_path.rglob("*"))
    for words in (["check", "--robot", "robot.toml", "run.csv"], ["gap", "--robot", "robot.toml", "run.csv"]):
        call(tmp_path, *words)
    assert appeared(tmp_path, before) == set()
    (tmp_path / "model.json").write_text('{"schema": "residual-mpc/model/1", "robot": "arm", "values": []}')
    for to in ("mjcf", "actuators", "sysid"):
        before = set(tmp_path.rglob("*"))
        call(tmp_path, "export", "model.json", "--to", to, "--robot", "robot.toml", "--out", to)
        assert appeared(tmp_path, before) == {to}


def test_a_module_of_the_users_own_leaves_no_bytecode(rover: Path) -> None:
    before = set(rover.rglob("*"))
    call(rover, "check", "--robot", "robot.toml", "run0.csv")
    assert appeared(rover, before) == set()


def test_warnings_of_the_engine_are_collected_once() -> None:
    model = mujoco.MjModel.from_xml_string(wheel_xml(HUB).replace("implicitfast", "Euler"))
    seen: list[str] = []
    mujoco.set_mju_user_warning(seen.append)
    try:
        with collected_warnings() as warnings:
            for _ in range(2):
                data = mujoco.MjData(model)
                data.qpos[0] = 0.3
                mujoco.mj_step(model, data, 100)
        assert len(warnings) == 1 and "QACC" in warnings[0] and "\n" not in warnings[0]
        assert len(seen) == 2 and mujoco.get_mju_user_warning() == seen.append
    finally:
        mujoco.set_mju_user_warning(None)
