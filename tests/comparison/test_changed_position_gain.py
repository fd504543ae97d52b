"""A change of a servo's position gain alone is told from one of its whole gain, which scales the damping as well."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pandas as pd
import pytest

import residual_mpc as rm

KP, KV, PERIOD = 8.0, 0.8, 0.012
ARM = """<mujoco><option timestep="{step}" integrator="implicitfast"/>
  <worldbody><body><joint name="hinge" axis="0 1 0" armature="0.01" damping="0.02"/>
    <geom type="capsule" fromto="0 0 0 0 0 -0.25" size="0.02" mass="0.6" contype="0"/></body></worldbody>
  <actuator><position name="servo" joint="hinge" kp="{kp}" kv="{kv}"/></actuator></mujoco>"""


def write_run(path: Path, kp: float, kv: float, seed: int) -> None:
    """9.6 s of steps plus a sine, simulated with a quarter of the model's time step."""
    rng = np.random.default_rng(seed)
    model = mujoco.MjModel.from_xml_string(ARM.format(step=0.0005, kp=kp, kv=kv))
    data, times = mujoco.MjData(model), PERIOD * np.arange(800)
    command = np.repeat(rng.uniform(-0.8, 0.8, 20), 40) + 0.3 * np.sin(rng.uniform(4.0, 9.0) * times)
    q = np.empty(len(times))
    for k, u in enumerate(command):
        q[k], data.ctrl[0] = data.qpos[0], u
        mujoco.mj_step(model, data, 24)
    table = {"t": times, "command.servo": command, "position.hinge": q + 1e-3 * rng.standard_normal(len(q))}
    pd.DataFrame(table).to_csv(path, index=False)


def compared(folder: Path, kp: float, kv: float) -> rm.Comparison:
    (folder / "arm.xml").write_text(ARM.format(step=0.002, kp=KP, kv=KV))
    (folder / "robot.toml").write_text('name = "arm"\nplant = "mujoco"\nmodel = "arm.xml"\n')
    for name, *gains in (("before", KP, KV), ("after", kp, kv)):
        (folder / name).mkdir()
        for k in range(3):
            write_run(folder / name / f"run{k}.csv", *gains, 10 * k + (name == "after"))
    robot = rm.load_robot(folder / "robot.toml")
    sets = [rm.read_runs(robot, folder / name) for name in ("before", "after")]
    return rm.compare(robot, *sets, only=("actuator_gain", "position_gain", "viscous_friction"))


def test_a_change_of_the_whole_gain_is_named(tmp_path: Path) -> None:
    """With high probability, although model and simulation use different time steps."""
    found = compared(tmp_path, 0.7 * KP, 0.7 * KV).document
    named = {c["effect"]: c for c in found["changes"]}
    assert named["actuator_gain"]["probability"] > 0.9 and found["notes"] == [] and found["verdict"] == "changed"
    assert named["actuator_gain"]["parameters"]["gain"]["change"]["value"] == pytest.approx(0.7, abs=0.02)
    assert all(c["probability"] < 0.5 for name, c in named.items() if name != "actuator_gain")


@pytest.mark.parametrize("factor", [pytest.param(0.7, marks=pytest.mark.slow), 1.4])
def test_a_change_of_the_position_gain_alone_is_named(tmp_path: Path, factor: float) -> None:
    found = compared(tmp_path, factor * KP, KV).document
    named = {c["effect"]: c for c in found["changes"]}
    assert named["position_gain"]["probability"] > 0.75 and found["verdict"] in ("changed", "partial")
    assert named["position_gain"]["parameters"]["gain"]["change"]["value"] == pytest.approx(factor, rel=0.03)
    assert all(c["probability"] < 0.5 for name, c in named.items() if name != "position_gain")
