"""A servo with another position gain than its model's is named as that, with what its limit and its damping show."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pandas as pd
import pytest

import residual_mpc as rm

ARM = """<mujoco><option timestep="{step}" integrator="implicitfast"/>
  <worldbody><body><joint name="lift" axis="0 1 0" armature="0.02" damping="0.05"/>
    <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.02" mass="0.8" contype="0" conaffinity="0"/>
    <body pos="0.3 0 0"><joint name="wrist" axis="0 1 0" armature="0.008" damping="0.02"/>
      <geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.02" mass="0.3" contype="0" conaffinity="0"/></body></body>
  </worldbody>
  <actuator><position name="m1" joint="lift" kp="{kp}" kv="2.0" forcerange="-12 12"/>
    <position name="m2" joint="wrist" kp="12" kv="0.8" forcerange="-4 4"/></actuator></mujoco>"""
KP, PERIOD = 35.0, 0.01


def write_run(path: Path, kp: float, seed: int) -> None:
    """8 s, simulated with a fifth of the model's step and another integrator of the servo: a firmware that answers the
    position every millisecond."""
    rng = np.random.default_rng(seed)
    model = mujoco.MjModel.from_xml_string(ARM.format(step=0.0004, kp=kp).replace("implicitfast", "Euler"))
    data, times = mujoco.MjData(model), PERIOD * np.arange(800)
    steps = np.repeat(rng.uniform(-0.7, 0.5, (20, 2)), 40, axis=0)
    command = steps + 0.25 * np.sin(np.outer(times, rng.uniform(4.0, 9.0, 2)))
    q = np.empty((len(times), 2))
    for k, u in enumerate(command):
        q[k], data.ctrl[:] = data.qpos, u
        mujoco.mj_step(model, data, 25)
    q += 8e-4 * rng.standard_normal(q.shape)
    names = ("t", "command.m1", "command.m2", "position.lift", "position.wrist")
    pd.DataFrame(dict(zip(names, (times, *command.T, *q.T), strict=True))).to_csv(path, index=False)


@pytest.mark.parametrize("factor", [pytest.param(0.6, marks=pytest.mark.slow), 1.4])
def test_a_position_gain_is_named_at_its_servo(tmp_path: Path, factor: float) -> None:
    (tmp_path / "arm.xml").write_text(ARM.format(step=0.002, kp=KP))
    (tmp_path / "robot.toml").write_text('name = "arm"\nplant = "mujoco"\nmodel = "arm.xml"\n')
    for k in range(3):
        write_run(tmp_path / f"run{k}.csv", factor * KP, k)
    robot = rm.load_robot(tmp_path / "robot.toml")
    runs = rm.read_runs(robot, [tmp_path / f"run{k}.csv" for k in range(3)])
    only = ("position_gain", "actuator_gain", "viscous_friction", "saturation", "payload", "armature")
    found = rm.diagnose(robot, runs, only=only).document
    (named,) = found["explanation"]
    assert (named["effect"], named["target"]) == ("position_gain", "m1") and found["verdict"] == "effects"
    low, high = named["parameters"]["gain"]["ci95"]
    assert low <= factor <= high and high - low < 0.1 and named["probability"] > 0.84
    (servo,) = (s for s in found["servos"] if s["actuator"] == "m1")
    values = {v["name"]: v["value"] for v in servo["values"]}
    assert values["stiffness"] == pytest.approx(factor * KP, rel=0.05) and values["damping"] == 2.0
