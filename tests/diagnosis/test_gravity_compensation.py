"""A controller that compensates gravity is named with its share, also beside a load of which it does not know; a
lighter arm is not taken for it, and where every axis is vertical it is not testable."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from oracles.rover_log import write_run

import residual_mpc as rm
from residual_mpc.logs.run import Run

NAMED = ("gravity_compensation", "payload", "link_mass", "actuator_gain", "torque_offset", "joint_spring")
PERIOD, FINE, SIGMA = 0.02, 0.0005, 5e-4  # s, s, rad
SERVOS = "".join(f'<position name="{j}" joint="{j}" kp="25" kv="2.5"/>' for j in ("shoulder", "elbow"))
ROBOT = 'name = "arm"\nplant = "mujoco"\nmodel = "arm.xml"\npayload_site = "tool"\n'


def arm(axis: str = "0 -1 0", more: float = 0.0, lighter: float = 0.0) -> str:
    """Two links; more: kg at the tool; lighter: kg that the second weight lacks."""
    return f"""
<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <default><geom contype="0" conaffinity="0"/><joint axis="{axis}" damping="0.1" armature="0.01"/></default>
  <worldbody>
    <body name="upper">
      <joint name="shoulder"/>
      <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.03" mass="0.6"/>
      <body name="lower" pos="0.3 0 0">
        <joint name="elbow"/>
        <geom type="sphere" size="0.03" pos="0.15 0 0" mass="{0.5 - lighter}"/>
        <geom type="sphere" size="0.01" pos="0.25 0 0" mass="{0.001 + more}"/>
        <site name="tool" pos="0.25 0 0"/>
      </body>
    </body>
  </worldbody>
  <actuator>{SERVOS}</actuator>
</mujoco>"""


def arm_run(seed: int, share: float, model: str, seconds: float = 10.0) -> Run:
    """Smooth motions and holds of servos to which share g(q) of the nominal arm is added every 0.5 ms, with bodies
    integrated by RK4 and the servos' damping in each of its stages."""
    rng = np.random.default_rng(seed)
    true, nominal = (mujoco.MjModel.from_xml_string(text) for text in (model, arm()))
    true.opt.timestep, true.opt.integrator = FINE, mujoco.mjtIntegrator.mjINT_RK4
    data, still = mujoco.MjData(true), mujoco.MjData(nominal)
    t = PERIOD * np.arange(round(seconds / PERIOD))
    at = np.linspace(0.0, seconds, 9)
    sent = np.stack([np.interp(t, at, rng.uniform(-1.0, 1.0, 9)) for _ in range(2)], axis=1)
    sent += 0.2 * np.sin(2.0 * np.pi * rng.uniform(0.6, 1.2, 2) * t[:, None])
    data.qpos[:] = sent[0]
    seen = np.empty_like(sent)
    for k in range(len(t)):
        seen[k], data.ctrl[:] = data.qpos, sent[k]
        for _ in range(round(PERIOD / FINE)):
            still.qpos[:] = data.qpos
            mujoco.mj_forward(nominal, still)
            data.qfrc_applied[:] = share * still.qfrc_bias
            mujoco.mj_step(true, data)
    seen += SIGMA * rng.standard_normal(seen.shape)
    columns = {f"{kind}.{j}": x[:, i] for i, j in enumerate(("shoulder", "elbow"))
               for kind, x in (("command", sent), ("position", seen))}  # fmt: skip
    return Run(f"run{seed}", t, columns)


def diagnosed(folder: Path, share: float, model: str, nominal: str, only: tuple[str, ...] = NAMED) -> rm.Diagnosis:
    (folder / "arm.xml").write_text(nominal)
    (folder / "robot.toml").write_text(ROBOT)
    for seed in range(3):
        write_run(arm_run(seed, share, model), folder)
    robot = rm.load_robot(folder / "robot.toml")
    return rm.diagnose(robot, rm.read_runs(robot, sorted(folder.glob("run*.csv"))), only=only)


@pytest.mark.parametrize("load", [0.0, pytest.param(0.25, marks=pytest.mark.slow)])
def test_a_compensation_is_named_with_its_share(tmp_path: Path, load: float) -> None:
    found = diagnosed(tmp_path, 0.9, arm(more=load), arm())
    named = {e["effect"]: e for e in found.explanation}
    assert set(named) == {"gravity_compensation", *(("payload",) if load else ())}
    assert named["gravity_compensation"]["parameters"]["share"]["value"] == pytest.approx(0.9, abs=0.04)
    if load:
        assert named["payload"]["parameters"]["mass"]["value"] == pytest.approx(load, rel=0.1)
    assert found.verdict == "effects" and "of the modelled gravity" in str(found)


@pytest.mark.slow
def test_a_lighter_arm_is_not_taken_for_it(tmp_path: Path) -> None:
    found = diagnosed(tmp_path, 0.0, arm(lighter=0.2), arm())
    assert "gravity_compensation" not in {e["effect"] for e in found.explanation}


def test_it_is_not_testable_about_vertical_axes(tmp_path: Path) -> None:
    vertical = arm("0 0 1")
    found = diagnosed(tmp_path, 0.0, vertical, vertical, ("gravity_compensation", "payload"))
    said = {e["effect"]: e["why"] for e in found.document["not_testable"]}
    assert "bears weight" in said["gravity_compensation"] and found.verdict == "no_gap"
