"""Runs of an unstable motion, in which the noise of the sensors hides everything, are no proof of a good model."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pandas as pd
import pytest

import residual_mpc as rm

BALANCED = """<mujoco><option timestep="0.002" integrator="implicitfast"/><worldbody><body>
<joint name="hip" axis="0 1 0" damping="0.0005"/><inertial pos="0 0 0.05" mass="0.5" diaginertia="1e-4 1e-4 1e-4"/>
</body></worldbody><actuator><motor name="hip" joint="hip"/></actuator></mujoco>"""
NOISE = 2e-3  # rad


def balance(seconds: float, seed: int) -> pd.DataFrame:
    """A log at 200 Hz of the body held upright by a controller that sees the true state, without a gap."""
    rng, every = np.random.default_rng(seed), 5
    model = mujoco.MjModel.from_xml_string(BALANCED.replace("0.002", "0.001"))
    data = mujoco.MjData(model)
    rows = []
    for k in range(round(200 * seconds)):
        wanted = 0.3 * np.sin(2.0 * 0.005 * k + seed) + 0.2 * np.sin(5.0 * 0.005 * k)
        torque = -1.0 * (data.qpos[0] - wanted) - 0.05 * data.qvel[0]
        rows.append((0.005 * k, torque, data.qpos[0] + NOISE * rng.standard_normal()))
        data.ctrl[0] = torque
        for _ in range(every):
            mujoco.mj_step(model, data)
    return pd.DataFrame(rows, columns=["t", "command.hip", "position.hip"])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("balanced")
    (place / "body.xml").write_text(BALANCED)
    (place / "robot.toml").write_text('name = "body"\nplant = "mujoco"\nmodel = "body.xml"\n')
    for seed in range(3):
        balance(8.0, seed).to_csv(place / f"run{seed}.csv", index=False)
    return place


@pytest.mark.parametrize(("horizon", "expected"), [(1.0, "unknown"), (0.1, "no_gap")])
def test_a_gap_within_noise_that_hides_everything_is_unknown(folder: Path, horizon: float, expected: str) -> None:
    """In a second the noise grows by e^14; in a tenth of it the model is tested, and right."""
    robot = rm.load_robot(folder / "robot.toml")
    found = rm.diagnose(robot, rm.read_runs(robot, folder), only=["viscous_friction"], horizon=horizon)
    gap = found.document["gap"]
    assert found.verdict == expected and gap["blinded"] == (expected == "unknown")
    assert (gap["noise_floor"] > gap["constant_velocity"]) == (expected == "unknown")
    assert ("These runs cannot test the model over 1 s" in str(found)) == (expected == "unknown")
