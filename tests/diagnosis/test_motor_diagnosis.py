"""A servo on a weak supply: simulated from its motor's circuit, and diagnosed as that supply."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from oracles.rover_log import write_run

import residual_mpc as rm
from residual_mpc.effects.servo.motor import Motor
from residual_mpc.logs.run import Run

STATED = Motor(7.4, 4.02, 0.387, 400.0, 0.0028774)
SUPPLY = 6.1  # V, what the servo has in truth
MASS, LENGTH, ARMATURE = 0.3, 0.1, 0.0018  # kg, m, kg m^2
PERIOD, FINE, SIGMA = 0.02, 2e-4, 4e-4  # s, s, rad

MODEL = f"""
<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body name="arm">
      <joint name="shaft" axis="0 1 0" armature="{ARMATURE}"/>
      <geom type="sphere" size="0.001" pos="0 0 -{LENGTH}" mass="{MASS}" contype="0" conaffinity="0"/>
    </body>
  </worldbody>
  <actuator><position name="servo" joint="shaft" kp="{STATED.stiffness}" kv="{STATED.damping}"/></actuator>
</mujoco>"""
ROBOT = f"""name = "servo"
plant = "mujoco"
model = "servo.xml"
[motor]
voltage = {STATED.voltage}
resistance = {STATED.resistance}
torque_constant = {STATED.torque_constant}
p_gain = {STATED.p_gain}
duty_per_rad = {STATED.duty_per_rad}
"""


def run(seed: int, seconds: float = 16.0) -> Run:
    """A pendulum under its servo, from the circuit's equations."""
    rng = np.random.default_rng(seed)
    inertia, kt = MASS * LENGTH**2 + ARMATURE, STATED.torque_constant
    levels = rng.uniform(-0.4, 0.4, 14)  # steps too small for the duty cycle to reach 1
    t = PERIOD * np.arange(round(seconds / PERIOD))
    sent = levels[np.searchsorted(np.cumsum(rng.uniform(0.7, 1.8, 13)), t)]
    q, w, seen = float(sent[0]), 0.0, np.empty(len(t))
    for k, target in enumerate(sent):
        seen[k] = q
        for _ in range(round(PERIOD / FINE)):
            duty = np.clip(STATED.p_gain * STATED.duty_per_rad * (target - q), -1.0, 1.0)
            current = (duty * SUPPLY - kt * w) / STATED.resistance
            w += FINE * (kt * current - MASS * 9.81 * LENGTH * np.sin(q)) / inertia
            q += FINE * w
    return Run(f"run{seed}", t, {"command.servo": sent, "position.shaft": seen + SIGMA * rng.standard_normal(len(t))})


@pytest.mark.slow
def test_a_weak_supply_is_said_in_volts(tmp_path: Path) -> None:
    (tmp_path / "servo.xml").write_text(MODEL)
    (tmp_path / "robot.toml").write_text(ROBOT)
    for seed in range(3):
        write_run(run(seed), tmp_path)
    robot = rm.load_robot(tmp_path / "robot.toml")
    runs = rm.read_runs(robot, sorted(tmp_path.glob("run*.csv")))
    found = rm.diagnose(robot, runs, only=("actuator_gain", "viscous_friction", "payload"))
    (gain,) = [e for e in found.explanation if e["effect"] == "actuator_gain"]
    supply, resistance, stiffness = gain["motor"]
    assert supply["quantity"] == "supply_voltage" and supply["value"] == pytest.approx(SUPPLY, rel=0.02)
    assert resistance["quantity"] == "resistance" and resistance["value"] > STATED.resistance
    assert stiffness["p_gain"] == STATED.p_gain
    (friction,) = [e for e in found.explanation if e["effect"] == "viscous_friction"]
    (damping,) = friction["motor"]  # as large as before: what changed is not the resistance
    assert damping["value"] == pytest.approx(STATED.damping, rel=0.02)
    assert "as if the supply were 6" in found.document["verdict_sentence"]
    (row,) = found.document["servos"]
    number = next(v for v in row["values"] if v["name"] == "stiffness")
    assert number["status"] == "corrected" and number["value"] == pytest.approx(stiffness["value"])
    assert any(change["setting"] == "P gain" for change in found.document["servo_changes"])
