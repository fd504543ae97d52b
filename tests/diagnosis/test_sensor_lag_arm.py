"""Encoders that follow slowly, on an arm: a lag of the actuators would do nearly the same."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from oracles.arms import arm_xml, robot_of

from residual_mpc.diagnosis.data.dataset import build_dataset
from residual_mpc.diagnosis.diagnose import diagnose
from residual_mpc.diagnosis.options import Options
from residual_mpc.diagnosis.predict.problem import _lags, start_sigma
from residual_mpc.logs.run import Run
from residual_mpc.models.settings import Knob, Term, assemble

LAG, STEP, RATE = 0.04, 5e-4, 100.0  # s, s, Hz
SIGMA = 1.5e-4  # rad


def servos(stiffness: float) -> str:
    """N m/rad, of the first; the damping of each is a twenty-fifth of its stiffness, s."""
    one = '<position name="j{0}" joint="j{0}" kp="{1}" kv="{2}"/>'
    return "".join(one.format(j, k, k / 25.0) for j, k in ((1, stiffness), (2, 0.5 * stiffness)))


def slow_run(seed: int, model: mujoco.MjModel) -> Run:
    """8 s at 100 Hz; the model is stepped four times as finely as the nominal one, and its encoders report an
    exponentially weighted mean of past angles."""
    rng = np.random.default_rng([seed, 11])
    period = round(1.0 / RATE / STEP)
    t = np.arange(int(8.0 * RATE)) / RATE
    tones = rng.uniform(0.2, 1.2, (4, 2)), rng.uniform(0.1, 0.3, (4, 2)), rng.uniform(0.0, 6.3, (4, 2))
    frequency, size, phase = (x[:, None] for x in tones)
    u = (size * np.sin(2.0 * np.pi * frequency * t[None, :, None] + phase)).sum(axis=0)
    data = mujoco.MjData(model)
    data.qpos[:] = u[0]
    true = np.empty((len(t) * period, 2))
    for k in range(len(true)):
        data.ctrl[:] = u[k // period]
        true[k] = data.qpos
        mujoco.mj_step(model, data)
    age = np.arange(int(10.0 * LAG / STEP))
    weight = np.exp(-STEP * age / LAG)
    slow = np.stack([np.convolve(np.pad(x, (len(age), 0), "edge"), weight / weight.sum())[len(age) :] for x in true.T])
    read = slow[:, : len(true)].T[::period] + SIGMA * rng.standard_normal((len(t), 2))
    columns = {f"command.j{j + 1}": u[:, j] for j in range(2)} | {f"position.j{j + 1}": read[:, j] for j in range(2)}
    return Run(f"r{seed}", t, columns)


@pytest.mark.slow
@pytest.mark.parametrize("stiffness", [60.0, 3000.0])
def test_it_is_not_taken_for_a_lag_of_the_actuators(tmp_path: Path, stiffness: float) -> None:
    """Named itself, or, where stiff servos make the two hard to tell apart, in a group with the one that is named."""
    xml = arm_xml(servos(stiffness))
    fine = mujoco.MjModel.from_xml_string(xml.replace('timestep="0.002"', f'timestep="{STEP}"'))
    assert fine.opt.timestep == STEP
    runs = [slow_run(k, fine) for k in range(4)]
    robot = robot_of(tmp_path, xml)
    found = diagnose(runs, [robot] * 4, {}, (), Options(), np.random.default_rng(0)).diagnosis
    wanted = Term("sensor_lag", None)
    named = {c.term for c in found.causes}
    grouped = {t for group in found.groups if (wanted,) in group for member in group for t in member}
    assert wanted in named or (stiffness > 1000.0 and grouped & named)
    late = next(c for c in found.causes if c.term == wanted or c.term in grouped)
    (number,) = late.parameters
    assert abs(number.value - LAG) < 0.004


def test_a_low_pass_widens_the_start_of_what_is_logged_behind_it(tmp_path: Path) -> None:
    """Positions by the time constant times the slope, velocities by it times the second derivative."""
    xml = arm_xml(servos(60.0))
    run = slow_run(0, mujoco.MjModel.from_xml_string(xml.replace('timestep="0.002"', f'timestep="{STEP}"')))
    rate = {f"velocity.j{j}": np.gradient(run.columns[f"position.j{j}"], run.t) for j in (1, 2)}
    robot = robot_of(tmp_path, xml)
    data = build_dataset([Run(run.name, run.t, {**run.columns, **rate})], [robot], {})
    settings = assemble([{Knob("sensor_lag", None, "time_constant"): LAG}], {"sensor_lag": robot.slots("sensor_lag")})
    lags = _lags(data, settings)
    assert lags == dict.fromkeys(("position.j1", "velocity.j1", "position.j2", "velocity.j2"), LAG)
    narrow, wide = start_sigma(data), start_sigma(data, lags)
    for channel in lags:
        assert (wide[channel] > 1.5 * narrow[channel]).mean() > 0.9
