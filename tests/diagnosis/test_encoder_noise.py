"""An encoder's coloured noise: larger than its jitter only if what is left is as large in slow motion as in fast."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from oracles.arms import robot_of, wheel_xml

from plants.mujoco_robot import MujocoRobot
from residual_mpc.diagnosis.data.dataset import Dataset, build_dataset
from residual_mpc.diagnosis.data.gap import measure_scales
from residual_mpc.diagnosis.fit.noise_evenness import unevenness
from residual_mpc.diagnosis.fit.noise_fit import fit_noise
from residual_mpc.diagnosis.fit.settings import FitSettings, NoiseFitSettings
from residual_mpc.diagnosis.predict.candidates import build_space
from residual_mpc.diagnosis.predict.problem import build_problem
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.logs.run import Run
from residual_mpc.models.settings import Settings

RATE, INERTIA, SIGMA, TIME = 50.0, 0.02, 0.004, 0.06  # Hz, kg m^2, rad, s


def turned(name: str, seed: int, damping: float = 0.0, seconds: float = 30.0) -> Run:
    """A wheel under sums of sines, integrated in steps of 0.2 ms; its angle with autoregressive noise."""
    rng = np.random.default_rng(seed)
    frequency, phase = rng.uniform(0.3, 1.5, 3), rng.uniform(0.0, 6.28, 3)
    n, fine = int(seconds * RATE), 100
    t = np.arange(n) / RATE
    torque = 0.05 * np.sin(2 * np.pi * frequency * t[:, None] + phase).sum(axis=1)
    q, v, angle = 0.0, 0.0, np.empty(n)
    for k in range(n):
        angle[k] = q
        for _ in range(fine):
            v += (torque[k] - damping * v) / INERTIA / RATE / fine
            q += v / RATE / fine
    rho = np.exp(-1.0 / RATE / TIME)
    noise = np.empty(n)
    noise[0] = SIGMA * rng.standard_normal()
    for k in range(1, n):
        noise[k] = rho * noise[k - 1] + SIGMA * np.sqrt(1.0 - rho**2) * rng.standard_normal()
    return Run(name, t, {"command.hub": torque, "position.hub": angle + noise})


def wheel(folder: Path) -> MujocoRobot:
    return robot_of(folder, wheel_xml())


def data_of(robot: MujocoRobot, damping: float = 0.0) -> Dataset:
    return build_dataset([turned(f"r{k}", k, damping) for k in range(2)], [robot] * 2, {})


def found(data: Dataset) -> float:
    problem = build_problem(data, build_space(data, ()), data.sigma)
    return fit_noise(problem, measure_scales(data), predict(data, Settings(1))[0], settings=FitSettings())[0].sigma


def test_wandering_encoders_of_a_perfect_robot_are_noise(tmp_path: Path) -> None:
    data = data_of(wheel(tmp_path))
    assert data.sigma[0] < 0.6 * SIGMA  # its jitter is much smaller
    assert found(data) == pytest.approx(SIGMA, rel=0.25)


def test_what_damping_leaves_is_none(tmp_path: Path) -> None:
    """The same with a torque that the model lacks: what it leaves grows with the speed."""
    data = data_of(wheel(tmp_path), damping=0.02)
    assert found(data) <= np.sqrt(2.0) * data.sigma[0] * 1.01


def test_thirds_are_alike_for_noise_and_not_for_an_error_that_grows_with_speed() -> None:
    rng = np.random.default_rng(0)
    predicted = np.sin(np.linspace(0.0, 60.0, 40 * 50)).reshape(40, 50, 1)
    noise = rng.standard_normal(predicted.shape)
    seen = np.ones(predicted.shape, dtype=bool)
    tuned = NoiseFitSettings()
    assert unevenness(noise, seen, predicted, [1, 2, 4], tuned) < 1.3
    grows = noise * np.abs(np.gradient(predicted, axis=1)) * 50.0
    assert unevenness(grows, seen, predicted, [1, 2, 4], tuned) > 2.0


def test_thirds_are_not_alike_for_an_error_that_acts_in_some_places() -> None:
    """Such as a hose that pulls at one end of the range, however fast the joint moves there."""
    rng = np.random.default_rng(0)
    turns = np.cumsum(np.repeat(rng.uniform(0.5, 4.0, 80), 25)) * 0.03
    predicted = np.abs((turns / np.pi) % 2.0 - 1.0).reshape(40, 50, 1)  # a saw of several speeds
    pulls = rng.standard_normal(predicted.shape) * np.where(predicted > 0.7, 3.0, 1.0)
    seen = np.ones(predicted.shape, dtype=bool)
    assert unevenness(pulls, seen, predicted, [1, 2, 4], NoiseFitSettings()) > 2.0
    assert unevenness(rng.standard_normal(predicted.shape), seen, predicted, [1, 2, 4], NoiseFitSettings()) < 1.4


def test_a_joint_that_stands_still_most_of_the_time_cannot_be_compared() -> None:
    rng = np.random.default_rng(0)
    predicted = np.zeros((40, 50, 1))
    predicted[:2] = rng.standard_normal((2, 50, 1))
    seen = np.ones(predicted.shape, dtype=bool)
    assert np.isinf(unevenness(rng.standard_normal(predicted.shape), seen, predicted, [1, 2], NoiseFitSettings()))


def test_fewer_samples_than_a_mean_asks_for_say_nothing() -> None:
    seen = np.zeros((40, 50, 1), dtype=bool)
    seen[:1] = True
    predicted = np.sin(np.linspace(0.0, 60.0, 40 * 50)).reshape(40, 50, 1)
    tuned = replace(NoiseFitSettings(), fewest_pairs=100)
    assert np.isinf(unevenness(predicted, seen, predicted, [1, 2], tuned))
