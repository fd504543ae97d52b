"""The integral part of a servo is named with its gain where errors die away, a load is not taken for it, and where no
servo takes positions that is said."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from oracles.rover_log import write_run

import residual_mpc as rm
from residual_mpc.logs.run import Run

NAMED = ("servo_integral", "actuator_gain", "torque_offset", "payload", "coulomb_friction")
PERIOD, FINE, SIGMA = 0.02, 0.0005, 5e-4  # s, s, rad
ROBOT = 'name = "lever"\nplant = "mujoco"\nmodel = "lever.xml"\n'


def lever(actuator: str, mass: float = 0.8) -> str:
    """A weight on a horizontal lever of 0.3 m."""
    return f"""
<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body name="lever">
      <joint name="hinge" axis="0 -1 0" damping="0.1" armature="0.01"/>
      <geom type="box" size="0.15 0.02 0.02" pos="0.15 0 0" mass="0.2" contype="0" conaffinity="0"/>
      <geom type="sphere" size="0.03" pos="0.3 0 0" mass="{mass}" contype="0" conaffinity="0"/>
      <site name="tool" pos="0.3 0 0"/>
    </body>
  </worldbody>
  <actuator>{actuator}</actuator>
</mujoco>"""


SERVO = '<position name="hinge" joint="hinge" kp="25" kv="2.5"/>'


def lever_run(seed: int, gain: float, mass: float = 0.8, seconds: float = 16.0) -> Run:
    """Steps that are held, by a servo whose integral part sums up errors at 0.5 ms by the trapezoidal rule, counting
    large ones for less, on bodies integrated by RK4; settled before the run."""
    rng = np.random.default_rng(seed)
    model = mujoco.MjModel.from_xml_string(lever('<motor name="hinge" joint="hinge"/>', mass))
    model.opt.timestep, model.opt.integrator = FINE, mujoco.mjtIntegrator.mjINT_RK4
    data = mujoco.MjData(model)
    levels = rng.uniform(-0.7, 0.7, 12)
    t = PERIOD * np.arange(round(seconds / PERIOD))
    sent = levels[np.searchsorted(np.cumsum(rng.uniform(1.2, 2.4, 11)), t)]
    data.qpos[0] = sent[0]
    mujoco.mj_forward(model, data)
    x = float(data.qfrc_bias[0]) / 25.0 if gain else 0.0
    seen, before = np.empty(len(t)), 0.0
    for k in range(len(t)):
        seen[k] = data.qpos[0]
        for _ in range(round(PERIOD / FINE)):
            error = sent[k] - data.qpos[0]
            counted = 1.5 * np.tanh(error / 1.5)
            x, before = x + gain * FINE * 0.5 * (counted + before), counted
            data.ctrl[0] = 25.0 * (error + x) - 2.5 * data.qvel[0]
            mujoco.mj_step(model, data)
    return Run(f"run{seed}", t, {"command.hinge": sent, "position.hinge": seen + SIGMA * rng.standard_normal(len(t))})


def diagnosed(folder: Path, runs: list[Run], actuator: str = SERVO, **keys: object) -> rm.Diagnosis:
    (folder / "lever.xml").write_text(lever(actuator))
    (folder / "robot.toml").write_text(ROBOT)
    for run in runs:
        write_run(run, folder)
    robot = rm.load_robot(folder / "robot.toml")
    return rm.diagnose(robot, rm.read_runs(robot, sorted(folder.glob("run*.csv"))), **keys)  # type: ignore[arg-type]


@pytest.mark.parametrize("gain", [0.8, pytest.param(4.0, marks=pytest.mark.slow)])
def test_an_integral_part_is_named_with_its_gain(tmp_path: Path, gain: float) -> None:
    found = diagnosed(tmp_path, [lever_run(seed, gain) for seed in range(3)], only=NAMED)
    (named,) = found.explanation
    assert (named["effect"], named["target"]) == ("servo_integral", None) and named["probability"] > 0.5
    number = named["parameters"]["gain"]
    assert number["value"] == pytest.approx(gain, rel=0.1) and number["unit"] == "1/s"
    assert number["ci95"][0] < number["value"] < number["ci95"][1]
    assert found.verdict == "effects" and found.gap["after"] < 0.1 * found.gap["before"]


@pytest.mark.slow
def test_a_load_is_not_taken_for_it(tmp_path: Path) -> None:
    found = diagnosed(tmp_path, [lever_run(seed, 0.0, 1.1) for seed in range(3)], only=NAMED)
    named = [e["effect"] for e in found.explanation]
    assert "payload" in named and "servo_integral" not in named


def test_no_integral_part_where_there_is_no_gap(tmp_path: Path) -> None:
    found = diagnosed(tmp_path, [lever_run(seed, 0.0) for seed in range(2)], only=("servo_integral",))
    assert found.verdict == "no_gap" and not found.explanation


def test_without_position_servos_it_is_not_testable(tmp_path: Path) -> None:
    motor = '<motor name="hinge" joint="hinge"/>'
    found = diagnosed(tmp_path, [lever_run(0, 0.0, seconds=3.0)], motor, only=("servo_integral", "payload"))
    said = {e["effect"]: e["why"] for e in found.document["not_testable"]}
    assert said["servo_integral"] == "no actuator is a position servo"
