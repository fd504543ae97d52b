"""A robot of the user's own, named as package.module:factory, through the command line."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cart_plant import Cart

from controllers.usual import usual_settings
from residual_mpc.errors import BadInput
from residual_mpc.export import Build, augment
from residual_mpc.models.protocol import Drive
from residual_mpc.models.settings import Knob, Settings

HERE = Path(__file__).resolve().parent
GAIN, TAU, NOISE = 0.8, 0.1, 0.001  # the true cart's gain; s; m


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A robot file, and two runs of a cart whose motor is weaker than its model."""
    there = tmp_path_factory.mktemp("cart")
    (there / "cart.toml").write_text('name = "cart"\nplant = "cart_plant:make"\n[parameters]\ntime_constant = 0.1\n')
    rng = np.random.default_rng(0)
    for run in ("one", "two"):
        rows, x, v = ["t,command.motor,position.rail"], 0.0, 0.0
        u = 0.0
        for k in range(1000):
            if k % 20 == 0:
                u = float(rng.uniform(-1, 1))
            rows.append(f"{0.02 * k:.3f},{u:.5f},{x + NOISE * rng.standard_normal():.6f}")
            for _ in range(20):
                x, v = x + 1e-3 * v, v + 1e-3 * (GAIN * u - v) / TAU
        (there / f"{run}.csv").write_text("\n".join(rows) + "\n")
    return there


def run(folder: Path, *arguments: str) -> dict:
    paths = os.pathsep.join([str(HERE), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "residual_mpc.cli.main",
            *arguments,
            "--robot",
            "cart.toml",
            "one.csv",
            "two.csv",
            "--json",
        ],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": paths},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_its_gap_is_measured(folder: Path) -> None:
    gap = run(folder, "gap")
    assert set(gap["channels"]) == {"position.rail"} and gap["model"] is None
    assert gap["nominal"] > 0.15 > 0.05 > gap["noise_floor"]


def test_its_cause_is_found(folder: Path) -> None:
    document = run(folder, "diagnose", "--out", "out")
    assert document["verdict"] == "effects"
    (cause,) = document["explanation"]
    assert cause["effect"] == "actuator_gain"
    assert cause["parameters"]["gain"]["value"] == pytest.approx(GAIN, abs=0.02)
    measured = run(folder, "gap", "--model", "out/model.json", "--held-out-of", "out/diagnosis.json")
    assert measured["model"] == pytest.approx(document["gap"]["after"], rel=1e-9)


def test_its_step_is_the_replay() -> None:
    """With effects, at the start of each of the replay's steps."""
    cart, dt, steps = Cart("cart", 0.1), 0.05, 60
    settings = Settings(
        1, {"command_delay": {"delay": np.array([[0.1]])}, "actuator_gain": {"gain": np.array([[0.8]])}}
    )
    u = 0.5 * np.sin(0.3 * np.arange(steps))
    model = augment(
        cart, {Knob("command_delay", None, "delay"): 0.1, Knob("actuator_gain", None, "gain"): 0.8}, None, Build(dt)
    )
    drive = Drive(dt, 10, np.concatenate([np.zeros(10), u])[None, :, None], None, np.zeros(1))
    start = {"position.rail": np.array([0.2]), "velocity.rail": np.zeros(1)}
    expected = cart.replay(start, drive, settings, ("position.rail", "velocity.rail"))
    x = model.start({"position.rail": 0.2})
    for k in range(steps):
        x = model.numpy_step(x, u[k : k + 1])
        assert x[:2] == pytest.approx([expected[c][0, k + 1] for c in ("position.rail", "velocity.rail")], abs=1e-12)


def test_a_step_without_the_range_of_its_command_has_no_usual_controller() -> None:
    model = augment(Cart("cart", 0.1), {}, None, Build(0.05))
    unknown = replace(model, stepped=replace(model.stepped, reach=()))
    with pytest.raises(BadInput, match="the range of 0 of its 1 commands"):
        usual_settings(unknown)
