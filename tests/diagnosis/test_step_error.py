"""A model that is stepped too coarsely is told so, and its error is not sold as an effect."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest
from oracles.arms import arm_xml, robot_of
from oracles.rover_euler import TRACK_WIDTH, WHEEL_RADIUS
from oracles.rover_log import rover_run

from plants.diff_drive import DiffDrive
from residual_mpc.diagnosis.data.dataset import build_dataset
from residual_mpc.diagnosis.data.gap import gap_of, measure_scales
from residual_mpc.diagnosis.data.settings import DataSettings
from residual_mpc.diagnosis.diagnose import diagnose
from residual_mpc.diagnosis.fit.least_squares import fit_all
from residual_mpc.diagnosis.options import Options
from residual_mpc.diagnosis.predict import step_error as step_error_module
from residual_mpc.diagnosis.predict.candidates import build_space
from residual_mpc.diagnosis.predict.noise_floor import floor_from
from residual_mpc.diagnosis.predict.problem import Problem, build_problem
from residual_mpc.diagnosis.predict.step_error import step_error, within_step_error
from residual_mpc.diagnosis.results import gaps, intervals
from residual_mpc.diagnosis.results.own_step import Seen, _explained
from residual_mpc.diagnosis.results.settings import ResultSettings
from residual_mpc.diagnosis.results.step_shift import finely_stepped
from residual_mpc.logs.run import Run
from residual_mpc.models.settings import Knob, Settings

FREE = '<motor name="j1" joint="j1"/><motor name="j2" joint="j2"/>'
SERVOS = '<position name="j1" joint="j1" kp="30" kv="3"/><position name="j2" joint="j2" kp="20" kv="1"/>'
NOISE = 2e-4  # rad


def xml(step: float, actuators: str = FREE) -> str:
    return arm_xml(actuators, integrator="Euler").replace('timestep="0.002"', f'timestep="{step}"')


def swinging(seed: int, seconds: float = 12.0, actuators: str = FREE, late: int = 0) -> Run:
    """The arm under small commands that act `late` samples late, stepped at 0.1 ms by RK4 and sampled at 100 Hz."""
    rng = np.random.default_rng(seed)
    spec = mujoco.MjSpec.from_string(xml(1e-4, actuators))
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
        data.ctrl[:] = u[max(k - late, 0)]
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


def test_predictions_that_differ_by_less_than_the_step_s_error_are_told(tmp_path: Path) -> None:
    delays = [{Knob("command_delay", None, "delay"): x} for x in (0.05, 0.051, 0.25)]
    for robot, wanted in ((robot_of(tmp_path, xml(0.01)), [True, True, False]), (None, [True, False, False])):
        runs = [swinging(1)] if robot else [rover_run("r", {}, 16.0, seed=0)]
        data = build_dataset(runs, [robot or DiffDrive("rover", WHEEL_RADIUS, TRACK_WIDTH)], {})
        rows = build_space(data, (), ("command_delay",)).settings(delays)
        assert within_step_error(data, measure_scales(data), rows, DataSettings()).tolist() == wanted


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


ONLY = ("link_mass", "payload", "viscous_friction", "armature")


@pytest.mark.slow
def test_a_gap_that_is_the_step_s_error_is_no_gap(tmp_path: Path) -> None:
    """The robot has no effect; the step alone makes a gap beyond the noise."""
    robot = robot_of(tmp_path, xml(0.005, SERVOS))
    runs = [swinging(seed, actuators=SERVOS) for seed in range(3)]
    found = diagnose(runs, [robot] * 3, {}, (), Options(only=ONLY), np.random.default_rng(0)).diagnosis
    assert found.gap.step_error is not None and found.gap.step_error > found.gap.noise_floor
    assert found.gap.before > 1.5 * found.gap.noise_floor
    assert found.verdict == "no_gap" and found.gap.own_step and not found.causes
    assert any("Use a smaller time step" in note for note in found.notes)


@pytest.mark.slow
def test_a_delay_beside_a_coarse_step_is_a_gap(tmp_path: Path) -> None:
    robot = robot_of(tmp_path, xml(0.005, SERVOS))
    runs = [swinging(seed, actuators=SERVOS, late=3) for seed in range(2)]
    options = Options(only=("command_delay",))
    found = diagnose(runs, [robot] * 2, {}, (), options, np.random.default_rng(0)).diagnosis
    assert found.verdict != "no_gap" and not found.gap.own_step


def delay_problem(tmp_path: Path) -> Problem:
    """Servos whose commands act 30 ms late, and a model with a step of 5 ms."""
    robot = robot_of(tmp_path, xml(0.005, SERVOS))
    runs = [swinging(seed, actuators=SERVOS, late=3) for seed in range(2)]
    data = build_dataset(runs, [robot] * 2, {}, 1.0, settings=DataSettings())
    return build_problem(data, build_space(data, (), ("command_delay",)), data.sigma, measure_scales(data).motion)


def test_the_fit_of_a_finer_step_is_foretold(tmp_path: Path) -> None:
    """The step shifts the motion by half of itself, far more than the noise lets the delay be off."""
    delay = Knob("command_delay", None, "delay")
    problem = delay_problem(tmp_path)
    fit = fit_all(problem, [{delay: 0.02}])[0]
    assert abs(fit.values[delay] - 0.03) > 0.0015
    assert finely_stepped(problem, fit)[delay] == pytest.approx(0.03, abs=0.0005)


def test_the_interval_holds_the_fit_of_a_finer_step(monkeypatch: pytest.MonkeyPatch) -> None:
    knob = Knob("track_width", None, "scale")
    monkeypatch.setattr(intervals, "finely_stepped", lambda problem, fit: {knob: 1.5})
    runs = [rover_run(f"r{k}", {"track_width": {"scale": 1.25}}, 16.0, seed=k) for k in range(2)]
    robot = DiffDrive("rover", WHEEL_RADIUS, TRACK_WIDTH)
    options = Options(only=("track_width",))
    found = diagnose(runs, [robot] * 2, {}, (), options, np.random.default_rng(0)).diagnosis
    (scale,) = found.causes[0].parameters
    low, high = scale.ci95
    assert low < 1.25 and high - 1.5 == pytest.approx(scale.value - low)


def test_a_model_of_equations_has_no_finer_step() -> None:
    robot = DiffDrive("rover", WHEEL_RADIUS, TRACK_WIDTH)
    data = build_dataset([rover_run("r", {}, 16.0)], [robot], {}, 1.0, settings=DataSettings())
    problem = build_problem(data, build_space(data, ()), data.sigma, measure_scales(data).motion)
    assert finely_stepped(problem, fit_all(problem, [{Knob("track_width", None, "scale"): 1.2}])[0]) == {}


@pytest.mark.parametrize(
    ("error", "left", "expected"), [(0.004, 0.005, True), (0.003, 0.005, False), (None, 0.005, False)]
)
def test_what_is_left_is_mostly_the_step_s_error(error: float | None, left: float, expected: bool) -> None:
    found: Any = SimpleNamespace(
        left=SimpleNamespace(total=left), looks=[SimpleNamespace(floor=SimpleNamespace(total=0.001))], step_error=error
    )
    assert gaps.ExplanationGaps.left_by_step(found, ResultSettings()) is expected


@pytest.mark.parametrize(("missed", "expected"), [(0.0, True), (0.15, True), (0.4, False)])
def test_a_small_part_of_the_step_s_error_may_be_left(missed: float, expected: bool) -> None:
    """What is left beyond the noise is this share of the step's error, of another shape."""
    data = build_dataset(
        [rover_run("r", {}, 16.0, seed=0)], [DiffDrive("rover", WHEEL_RADIUS, TRACK_WIDTH)], {}, 1.0,
        settings=DataSettings(),
    )  # fmt: skip
    scales, settings = measure_scales(data), ResultSettings()
    rng = np.random.default_rng(0)
    noise, step, other = (
        size * scales.motion * rng.standard_normal(data.y.shape) for size in (0.001, 0.01, missed * 0.01)
    )
    draws = [gap_of(data, scales, 0.001 * scales.motion * rng.standard_normal(data.y.shape)) for _ in range(8)]
    floor = floor_from(draws, data.count, settings=settings.predict)
    seen = Seen(data, noise + step + other, scales, floor)
    assert seen.less(1.0, step).beyond_noise(settings) == (missed > 0.0)
    assert _explained(seen, 1.0, step, settings) is expected
    assert _explained(seen, 1.0, None, settings) is False


@pytest.mark.parametrize(
    ("of_step", "other", "expected"),
    [(0.8, 0.002, True), (0.3, 0.002, True), (0.0, 0.01, False), (1.0, 0.02, False), (None, 0.01, False)],
)
def test_what_is_left_has_to_look_like_the_step_s_error(
    of_step: float | None, other: float, expected: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A rest as large as the error of the time step is made by it only where a share of that error takes it out."""
    data = build_dataset(
        [rover_run("r", {}, 16.0, seed=0)], [DiffDrive("rover", WHEEL_RADIUS, TRACK_WIDTH)], {}, 1.0,
        settings=DataSettings(),
    )  # fmt: skip
    scales, rng = measure_scales(data), np.random.default_rng(0)
    step, rest = (size * scales.motion * rng.standard_normal(data.y.shape) for size in (0.01, other))
    left = rest + (0.0 if of_step is None else of_step) * step
    monkeypatch.setattr(step_error_module, "predict", lambda few, row: [few.y - left[: few.count]])
    monkeypatch.setattr(
        step_error_module, "finer_prediction", lambda few, *_: None if of_step is None else step[: few.count]
    )
    monkeypatch.setattr(step_error_module, "MADE_WINDOWS", data.count)
    found = step_error_module.made_by_step(data, scales, Settings(1), 1e-6, DataSettings())
    assert found is expected
