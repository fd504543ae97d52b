"""The whole way: a twin's run, its gap through the command line, and its withheld effects named."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from plants.scaler_arm.engines.mujoco_arm import MujocoArm
from plants.scaler_arm.kinematics.loop_closure import at_posture
from plants.scaler_arm.motions import CircleWithHeight, references
from plants.scaler_arm.twin import ENCODERS, twin
from plants.scaler_arm.withheld import Withheld
from plants.sensors import Sensed
from plants.simulator import Recording, Simulator, record, replaying, write_run
from residual_mpc.cli.main import cli

MOTION = CircleWithHeight(radius=0.05, period=4.0)
WITHHELD = Withheld(delay=0.0237, payload=0.113)


def recorded(simulator: Simulator, path: Path, seconds: float) -> str:
    """The path, as text, of a run of the simulator drawing MOTION."""
    q = references(MOTION, np.arange(0.0, seconds + 0.005, 0.01))
    how = Recording(seconds, 0.01, at_posture(q[0]))
    write_run(record(simulator, replaying(q, 0.01), how, np.random.default_rng(1)), path)
    return str(path)


def answer(*arguments: str) -> dict:  # type: ignore[type-arg]
    done = CliRunner().invoke(cli, [*arguments, "--json"])
    assert done.exit_code == 0, done.output
    return json.loads(done.stdout)  # type: ignore[no-any-return]


def test_the_gap_is_that_of_the_withheld_effects(tmp_path: Path) -> None:
    """A run of the model itself has none beyond its sensors' noise; the twin's is the delay's and the payload's."""
    same = recorded(Sensed(MujocoArm(), (ENCODERS,)), tmp_path / "same.csv", 5.0)
    other = recorded(twin("mujoco", WITHHELD), tmp_path / "other.csv", 5.0)
    own = answer("gap", "--robot", "scaler_arm", same)
    assert own["nominal"] < 1.3 * own["noise_floor"] and own["windows"] == 5 and not own["still"]
    gap = answer("gap", "--robot", "scaler_arm", other)
    assert gap["nominal"] > 8 * gap["noise_floor"]
    assert len(gap["channels"]) == 6


@pytest.mark.slow
def test_what_was_withheld_is_named(tmp_path: Path) -> None:
    run = recorded(twin("mujoco", WITHHELD, (ENCODERS,)), tmp_path / "run.csv", 8.0)
    told = answer(
        "diagnose", "--robot", "scaler_arm", run, "--only", "command_delay,payload,actuator_lag",
        "--out", str(tmp_path / "out"),
    )  # fmt: skip
    assert told["verdict"] == "effects"
    found = {e["effect"]: e["parameters"] for e in told["explanation"]}
    assert set(found) == {"command_delay", "payload"}
    assert found["command_delay"]["delay"]["value"] == pytest.approx(WITHHELD.delay, abs=2e-4)
    assert found["payload"]["mass"]["value"] == pytest.approx(WITHHELD.payload, abs=0.006)
