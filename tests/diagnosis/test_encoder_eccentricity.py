"""An encoder whose disc sits off its shaft's axis, read by its geometry, on a servo that closes its loop elsewhere."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pandas as pd
import pytest

import residual_mpc as rm
from residual_mpc.diagnosis.data.dataset import build_dataset
from residual_mpc.diagnosis.predict.readings import LocalValue, reading_of
from residual_mpc.models.sensing import sensed
from residual_mpc.models.settings import Knob, Settings, assemble

ARM = """<mujoco><option timestep="{step}" integrator="{integrator}"/>
  <worldbody><body><joint name="hinge" axis="0 1 0" armature="0.01" damping="0.05"/>
    <geom type="capsule" fromto="0 0 0 0 0 -0.25" size="0.02" mass="0.5" contype="0" conaffinity="0"/></body>
  </worldbody>
  <actuator><position name="servo" joint="hinge" kp="15" kv="0.9"/></actuator></mujoco>"""
CHANNEL, AMPLITUDE, PHASE, PERIOD = "position.hinge", 0.08, 0.7, 0.01


def off_axis(q: np.ndarray) -> np.ndarray:
    """What a head reads of a disc whose centre lies beside the axis it turns about."""
    away = q + PHASE
    return q + np.arctan2(AMPLITUDE * np.sin(away), 1.0 - AMPLITUDE * np.cos(away))


def write_run(path: Path, seed: int, reach: float, eccentric: bool = True) -> None:
    """8 s of steps and a sine, simulated with a quarter of the model's step and another integrator."""
    rng = np.random.default_rng(seed)
    model = mujoco.MjModel.from_xml_string(ARM.format(step=0.0005, integrator="Euler"))
    data, times = mujoco.MjData(model), PERIOD * np.arange(800)
    command = np.repeat(rng.uniform(-reach, reach, 16), 50) + 0.2 * reach * np.sin(rng.uniform(4.0, 9.0) * times)
    q = np.empty(len(times))
    for k, u in enumerate(command):
        q[k], data.ctrl[0] = data.qpos[0], u
        mujoco.mj_step(model, data, 20)
    seen = (off_axis(q) if eccentric else q) + 1e-3 * rng.standard_normal(len(q))
    pd.DataFrame({"t": times, "command.servo": command, CHANNEL: seen}).to_csv(path, index=False)


def robot_and_runs(folder: Path, reach: float, eccentric: bool = True) -> tuple[rm.NominalRobot, rm.Runs]:
    (folder / "arm.xml").write_text(ARM.format(step=0.002, integrator="implicitfast"))
    (folder / "robot.toml").write_text('name = "arm"\nplant = "mujoco"\nmodel = "arm.xml"\n')
    for k in range(3):
        write_run(folder / f"run{k}.csv", k, reach, eccentric)
    robot = rm.load_robot(folder / "robot.toml")
    return robot, rm.read_runs(robot, [folder / f"run{k}.csv" for k in range(3)])


def test_it_is_named_with_amplitude_and_phase(tmp_path: Path) -> None:
    robot, runs = robot_and_runs(tmp_path, 1.8)
    only = ("encoder_eccentricity", "sensor_scale", "sensor_bias", "joint_spring", "torque_offset", "actuator_gain")
    found = rm.diagnose(robot, runs, only=only).document
    (named,) = found["explanation"]
    assert (named["effect"], named["target"]) == ("encoder_eccentricity", CHANNEL)
    assert found["verdict"] == "effects" and named["probability"] > 0.84
    for name, true in (("amplitude", AMPLITUDE), ("phase", PHASE)):
        low, high = named["parameters"][name]["ci95"]
        assert low <= true <= high and high - low < 0.3


def test_a_joint_that_hardly_turns_does_not_show_it(tmp_path: Path) -> None:
    robot, runs = robot_and_runs(tmp_path, 0.3, eccentric=False)
    found = rm.diagnose(robot, runs, only=("encoder_eccentricity",)).document
    (said,) = found["not_testable"]
    assert said["effect"] == "encoder_eccentricity" and "a scale and a bias" in said["why"]


@pytest.mark.parametrize("scale", [1.0, 1.2])
def test_readings_lead_back_to_the_angle(tmp_path: Path, scale: float) -> None:
    """Through the largest amplitude, beside a scale and a bias; a row without it stays as it is, bit for bit."""
    robot, runs = robot_and_runs(tmp_path, 1.8)
    data = build_dataset(runs.runs[:1], [robot.model], {})
    size, phase = (Knob("encoder_eccentricity", CHANNEL, p) for p in ("amplitude", "phase"))
    beside = {Knob("sensor_scale", CHANNEL, "scale"): scale, Knob("sensor_bias", CHANNEL, "bias"): 0.1}
    row = {size: 0.5, phase: 0.4, **beside}
    slots = {e: robot.model.slots(e) for e in ("encoder_eccentricity", "sensor_scale", "sensor_bias")}
    reading = reading_of(data, data.blocks[0], assemble([row, beside], slots), CHANNEL)
    true = np.tile(np.linspace(-3.0, 3.0, data.count), (2, 1))
    seen = reading.of(true[:, :, None])[:, :, 0]
    np.testing.assert_allclose(seen[0], scale * true[0] + 0.5 * np.sin(true[0] + 0.4) + 0.1, atol=1e-12)
    plain = reading_of(data, data.blocks[0], assemble([beside], slots), CHANNEL)
    np.testing.assert_array_equal(seen[1:], plain.of(true[1:, :, None])[:, :, 0])
    back = reading.memory(seen)
    np.testing.assert_allclose(back, true, atol=1e-6)
    slope = np.stack([scale + 0.5 * np.cos(true[0] + 0.4), np.full(data.count, scale)])
    rate = reading.rate(LocalValue(seen, slope * 2.0, np.zeros_like(seen)))
    np.testing.assert_allclose(rate, 2.0, atol=1e-5)


def test_an_encoder_that_would_turn_back_does_no_harm(tmp_path: Path) -> None:
    """A scale of 0.3 under an amplitude of 0.5: no angle is unique, and none runs away."""
    robot, runs = robot_and_runs(tmp_path, 1.8)
    data = build_dataset(runs.runs[:1], [robot.model], {})
    row = {Knob("encoder_eccentricity", CHANNEL, p): v for p, v in (("amplitude", 0.5), ("phase", 0.4))}
    row[Knob("sensor_scale", CHANNEL, "scale")] = 0.3
    slots = {e: robot.model.slots(e) for e in ("encoder_eccentricity", "sensor_scale")}
    reading = reading_of(data, data.blocks[0], assemble([row], slots), CHANNEL)
    seen = np.linspace(-1.0, 1.0, data.count)[None, :]
    back = reading.memory(seen)
    assert np.abs(back).max() < 2.0 / 0.3 + 2.0 * np.pi
    rate = reading.rate(LocalValue(seen, np.ones_like(seen), np.zeros_like(seen)))
    assert np.isfinite(rate).all() and np.abs(rate).max() < 20.0


def test_a_stepped_robot_reads_the_same(tmp_path: Path) -> None:
    robot, _ = robot_and_runs(tmp_path, 0.3)
    slots = {"encoder_eccentricity": robot.model.slots("encoder_eccentricity")}
    row = {Knob("encoder_eccentricity", CHANNEL, p): v for p, v in (("amplitude", 0.2), ("phase", 0.4))}
    true = {CHANNEL: np.array([0.3]), "velocity.hinge": np.array([1.0])}
    read = sensed(robot.model, assemble([row], slots), true, true)
    assert read[CHANNEL] == pytest.approx(0.3 + 0.2 * np.sin(0.7)) and read["velocity.hinge"] == 1.0
    assert sensed(robot.model, Settings(1), true, true)[CHANNEL] == 0.3
