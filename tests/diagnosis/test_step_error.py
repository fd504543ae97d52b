"""A model that is stepped too coarsely is told so, and its error is not sold as an effect."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from oracles.arms import arm_xml, robot_of
from oracles.rover_euler import TRACK_WIDTH, WHEEL_RADIUS
from oracles.rover_log import rover_run

from plants.diff_drive import DiffDrive
from residual_mpc.diagnosis.data.dataset import build_dataset
from residual_mpc.diagnosis.data.gap import measure_scales
from residual_mpc.diagnosis.data.settings import DataSettings
from residual_mpc.diagnosis.diagnose import diagnose
from residual_mpc.diagnosis.options import Options
from residual_mpc.diagnosis.predict.step_error import step_error
from residual_mpc.diagnosis.results import gaps
from residual_mpc.logs.run import Run
from residual_mpc.models.settings import Settings

FREE = '<motor name="j1" joint="j1"/><motor name="j2" joint="j2"/>'
NOISE = 2e-4  # rad


def xml(step: float) -> str:
    return arm_xml(FREE, integrator="Euler").replace('timestep="0.002"', f'timestep="{step}"')


def swinging(seed: int, seconds: float = 12.0) -> Run:
    """The arm under small torques, stepped at 0.1 ms by RK4 and sampled at 100 Hz."""
    rng = np.random.default_rng(seed)
    spec = mujoco.MjSpec.from_string(xml(1e-4))
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[:] = (np.pi / 2 - 0.4, 0.3)
    t, q, u = 0.01 * np.arange(round(seconds / 0.01)), [], []
    for k in range(len(t)):
        if k % 30 == 0:
            command = 0.6 * rng.standard_normal(2)
        q.append(data.qpos.copy())
        u.append(command)
        data.ctrl[:] = command
        for _ in range(100):
            mujoco.mj_step(model, data)
    measured = np.array(q) + NOISE * rng.standard_normal((len(t), 2))
    columns = {f"command.j{i + 1}": np.array(u)[:, i] for i in range(2)}
    return Run(f"run{seed}", t, columns | {f"position.j{i + 1}": measured[:, i] for i in range(2)})


def test_halving_the_step_halves_the_error(tmp_path: Path) -> None:
    found = []
    for step in (0.01, 0.005):
        robot = robot_of(tmp_path, xml(step))
        data = build_dataset([swinging(1)], [robot], {}, 1.0, settings=DataSettings())
        found.append(step_error(data, measure_scales(data), Settings(1), settings=DataSettings()) or 0.0)
    assert found[0] == pytest.approx(2 * found[1], rel=0.3)


@pytest.mark.parametrize("error", [0.0, 1.0])
def test_a_large_step_error_limits_every_probability(monkeypatch: pytest.MonkeyPatch, error: float) -> None:
    """A track that is beyond doubt, judged by a model whose step is said to err by nothing and by much."""
    monkeypatch.setattr(gaps, "step_error", lambda *given, **settings: error)
    runs = [rover_run(f"r{k}", {"track_width": {"scale": 1.25}}, 16.0, seed=k) for k in range(2)]
    robot = DiffDrive("rover", WHEEL_RADIUS, TRACK_WIDTH)
    options = Options(only=("track_width",))
    found = diagnose(runs, [robot] * 2, {}, (), options, np.random.default_rng(0)).diagnosis
    (cause,) = found.causes
    assert (cause.probability <= 0.5) == bool(error) and (error > 0 or cause.probability > 0.9)
    assert any("the named effects may only stand" in note for note in found.notes) == bool(error)


def test_effects_that_may_stand_for_the_step_are_doubted(tmp_path: Path) -> None:
    """The robot has no effect; what a coarse step makes of it is doubted, and the notes say why."""
    robot = robot_of(tmp_path, xml(0.01))
    runs = [swinging(seed) for seed in range(3)]
    only = ("link_mass", "payload", "viscous_friction", "armature")
    found = diagnose(runs, [robot] * 3, {}, (), Options(only=only), np.random.default_rng(0)).diagnosis
    assert found.gap.step_error is not None and found.gap.step_error > found.gap.noise_floor
    assert any("time step" in note for note in found.notes)
    assert all(cause.probability <= 0.5 for cause in found.causes)
