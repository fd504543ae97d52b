"""Where a payload sits is found where the runs show it, and stays at the site where they do not."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest
from oracles.arms import arm_xml, robot_of

from residual_mpc.diagnosis.data.dataset import build_dataset
from residual_mpc.diagnosis.data.gap import measure_scales
from residual_mpc.diagnosis.diagnose import diagnose
from residual_mpc.diagnosis.fit.least_squares import Fit, fit_all
from residual_mpc.diagnosis.fit.settings import FitSettings
from residual_mpc.diagnosis.options import Options
from residual_mpc.diagnosis.predict.candidates import build_space
from residual_mpc.diagnosis.predict.problem import build_problem
from residual_mpc.diagnosis.results.document import to_document
from residual_mpc.diagnosis.results.settings import ResultSettings
from residual_mpc.diagnosis.search.instead_of_numbers import instead_of_numbers
from residual_mpc.diagnosis.search.optional_numbers import (
    at_bounds,
    makeup,
    shifts_without,
    unshown,
    with_all_free,
    without_numbers,
)
from residual_mpc.logs.run import Run
from residual_mpc.models.settings import Knob, Term

SIGMA, DT, SECONDS, FINE = 1e-3, 0.02, 10.0, 0.0005  # rad, s, s, s
T = DT * np.arange(int(SECONDS / DT) + 1)
NOISE = {"position.j1": SIGMA, "position.j2": SIGMA}
PLANAR = arm_xml().replace('axis="0 1 0.2"', 'axis="0 1 0"')  # both joints turn about the site's y
MASS, X, Y, Z = (Knob("payload", None, name) for name in ("mass", "x", "y", "z"))
GAIN = Knob("actuator_gain", None, "gain")


def loaded_run(xml: str, mass: float, offset: tuple[float, float, float], gain: float = 1.0) -> Run:
    """The truth: the model compiled with a body beside the site, stepped by RK4 four times as finely; gain: times the
    servos' torques."""
    rng, spec = np.random.default_rng(1), mujoco.MjSpec.from_string(xml)
    spec.option.timestep, spec.option.integrator = FINE, mujoco.mjtIntegrator.mjINT_RK4
    at = next(s for s in spec.sites if s.name == "tool").pos
    load = spec.body("lower").add_body(pos=at + np.array(offset))
    load.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[1e-3, 0, 0], mass=mass, contype=0, conaffinity=0)
    model = spec.compile()
    model.actuator_gainprm *= gain
    model.actuator_biasprm *= gain
    u = np.stack(
        [
            2.0 * sum(rng.uniform(0.1, 0.3) * np.sin(2 * np.pi * f * T + rng.uniform(0, 6)) for f in (0.4, 0.9, 1.7))
            for _ in NOISE
        ],
        axis=1,
    )
    data, q = mujoco.MjData(model), []
    for command in u:
        q.append(data.qpos.copy())
        data.ctrl[:] = command
        mujoco.mj_step(model, data, round(DT / FINE))
    seen = np.array(q) + SIGMA * rng.standard_normal(u.shape)
    columns = {f"command.j{i + 1}": u[:, i] for i in range(2)}
    return Run("run", T, columns | {c: seen[:, i] for i, c in enumerate(NOISE)})


def diagnosed(
    folder: Path, xml: str, mass: float, offset: tuple[float, float, float], other: str = "link_mass"
) -> dict[str, Any]:
    """diagnosis.json, of a payload and one other effect."""
    robot, options = robot_of(folder, xml, payload_site="tool"), Options(only=("payload", other))
    made = diagnose([loaded_run(xml, mass, offset)], [robot], NOISE, (), options, np.random.default_rng(0))
    return to_document(made.diagnosis)


def assert_found(document: dict[str, Any], truth: dict[str, float]) -> None:
    """The payload alone is named, with these numbers and no others, the true ones within their intervals."""
    assert document["verdict"] == "effects"
    (named,) = document["explanation"]
    assert named["effect"] == "payload" and named["parameters"].keys() == truth.keys()
    for name, value in truth.items():
        low, high = named["parameters"][name]["ci95"]
        assert low < value < high
    assert {v["parameter"] for v in document["model"]["values"]} == truth.keys()


def test_a_payload_at_the_site_stays_there(tmp_path: Path) -> None:
    assert_found(diagnosed(tmp_path, arm_xml(), 0.3, (0.0, 0.0, 0.0)), {"mass": 0.3})


def test_a_payload_ahead_of_the_site_is_found_there(tmp_path: Path) -> None:
    assert_found(diagnosed(tmp_path, arm_xml(), 0.3, (0.08, 0.0, 0.0)), {"mass": 0.3, "x": 0.08})


@pytest.mark.slow
def test_two_coordinates_are_found_where_a_third_looks_alike(tmp_path: Path) -> None:
    assert_found(diagnosed(tmp_path, arm_xml(), 0.3, (0.05, 0.0, -0.06)), {"mass": 0.3, "x": 0.05, "z": -0.06})


@pytest.mark.slow
def test_a_coordinate_along_parallel_axes_stays_0(tmp_path: Path) -> None:
    fine = PLANAR.replace('timestep="0.002"', 'timestep="0.001"')
    found = diagnosed(tmp_path, fine, 0.3, (0.06, 0.05, 0.0), "viscous_friction")
    assert_found(found, {"mass": 0.3, "x": 0.06})


@pytest.mark.parametrize(("gain", "offset"), [(0.8, 0.0), (1.0, 0.08)])
def test_an_effect_replaces_a_coordinate_only_where_it_fits_better(tmp_path: Path, gain: float, offset: float) -> None:
    robot, settings = robot_of(tmp_path, arm_xml(), payload_site="tool"), ResultSettings()
    data = build_dataset([loaded_run(arm_xml(), 0.3, (offset, 0.0, 0.0), gain)], [robot], NOISE)
    problem = build_problem(data, build_space(data, ()), data.sigma, measure_scales(data).motion)
    (fit,) = fit_all(problem, [{MASS: 0.3, X: 0.02}], settings=settings.fit)
    found = instead_of_numbers(problem, fit, (), settings.search)
    if gain == 1.0:
        assert found is None
        return
    assert found is not None and found.terms == (MASS.term, GAIN.term) and X not in found.values
    assert found.values[GAIN] == pytest.approx(gain, abs=0.01) and found.values[MASS] == pytest.approx(0.3, abs=0.01)
    other = instead_of_numbers(problem, fit, (GAIN.term,), settings.search)
    assert other is None or GAIN not in other.values  # refuted before


def test_no_first_look_is_taken_at_the_coordinates(tmp_path: Path) -> None:
    robot = robot_of(tmp_path, arm_xml())
    data = build_dataset([loaded_run(arm_xml(), 0.3, (0.0, 0.0, 0.0))], [robot], NOISE)
    space = build_space(data, ())
    term = Term("payload", None)
    assert space.knobs(term) == (MASS,) and space.optional(term) == (X, Y, Z)
    assert all(probe.keys() == {MASS} for probe in space.probes(term))
    assert with_all_free(space, {MASS: 0.3}) == {MASS: 0.3}
    assert with_all_free(space, {MASS: 0.3, Y: 0.1}) == {MASS: 0.3, Y: 0.1, X: 0.0, Z: 0.0}


def test_sets_with_other_numbers_free_are_other_sets() -> None:
    at_site, ahead = {MASS: 0.3}, {MASS: 0.3, X: 0.05}
    assert makeup(at_site) == makeup({MASS: 0.1}) != makeup(ahead)
    assert without_numbers(ahead, X) == at_site


def test_a_coordinate_at_its_bound_is_found_out(tmp_path: Path) -> None:
    """A light load far out feigns a rotor: the largest distance is no place where a tool is found."""
    run = loaded_run(PLANAR, 0.0, (0.0, 0.0, 0.0))
    data = build_dataset([run], [robot_of(tmp_path, PLANAR)], NOISE, 1.0)
    space = build_space(data, (), ("payload",))
    low, high = space.bounds(X)
    for x, found in ((0.5 * high, ()), (0.995 * high, (X,)), (low, (X,))):
        fit: Any = SimpleNamespace(values={MASS: 0.1, X: x, Z: 0.01})
        assert at_bounds(space, fit) == found


def linear_fit(values: tuple[float, ...], hessian: np.ndarray) -> tuple[Fit, np.ndarray]:
    """A fit of mass, x, y and z with white residuals and J'J = hessian, in 400 windows that are each a block."""
    rng, windows = np.random.default_rng(0), 400
    q, _ = np.linalg.qr(rng.standard_normal((windows, 5)))
    jacobian = (q[:, 1:] @ np.linalg.cholesky(hessian).T)[:, None, :]
    r = rng.standard_normal(windows)
    r = r - q[:, 1:] @ (q[:, 1:].T @ r)
    knobs = (MASS, X, Y, Z)
    held = np.zeros(4, dtype=bool)
    named = dict(zip(knobs, values, strict=True))
    fit = Fit((Term("payload", None),), knobs, named, np.ones(4), float(r @ r), r[:, None], jacobian, held)
    return fit, np.arange(windows)


SPACE: Any = SimpleNamespace(null=lambda knob: 0.0, bounds=lambda knob: (-0.3, 0.3))


def test_what_is_not_told_from_0_is_left_out() -> None:
    fit, blocks = linear_fit((0.3, 0.08, 0.005, -0.004), np.diag([1e4] * 4))  # standard deviations of 0.01
    assert set(unshown(SPACE, fit, {}, 3, blocks, FitSettings())) == {Y, Z}
    nothing, _ = linear_fit((0.3, 0.01, 0.005, -0.004), np.diag([1e4] * 4))
    assert set(unshown(SPACE, nothing, {}, 3, blocks, FitSettings())) == {X, Y, Z}


def test_of_coordinates_that_look_alike_the_shorter_stays() -> None:
    """What is known is y + 3 z = 0.18: z = 0.06 or y = 0.18."""
    along = np.array([1.0, 3.0]) / 0.01
    hessian = np.diag([1e4, 1e4, 1.0, 1.0])
    hessian[2:, 2:] += np.outer(along, along)
    fit, blocks = linear_fit((0.3, 0.08, 0.09, 0.03), hessian)
    assert unshown(SPACE, fit, {}, 3, blocks, FitSettings()) == (Y,)


def test_no_more_stay_than_were_found_nor_what_a_finer_step_turns_round() -> None:
    fit, blocks = linear_fit((0.3, 0.08, 0.05, 0.06), np.diag([1e4] * 4))
    assert unshown(SPACE, fit, {}, 3, blocks, FitSettings()) == ()
    assert unshown(SPACE, fit, {}, 2, blocks, FitSettings()) == (Y,)
    assert unshown(SPACE, fit, {**fit.values, X: -0.04}, 3, blocks, FitSettings()) == (X,)


def test_a_number_that_is_left_out_may_shift_the_others() -> None:
    """What is known is 4 mass + z = 1.2: with a height of 0.1 m to either side, 25 g. Nothing else depends on it."""
    along = np.array([4.0, 1.0]) / 0.001
    hessian = np.diag([1.0, 1e4, 1e4, 1.0])
    hessian[np.ix_([0, 3], [0, 3])] += np.outer(along, along)
    fit, blocks = linear_fit((0.3, 0.08, 0.05, 0.0), hessian)
    space: Any = SimpleNamespace(null=lambda knob: 0.0, scale=lambda knob: 0.1)
    down, up = (shift[MASS] for shift in shifts_without(space, fit, [Z], blocks))
    assert (down, up) == (pytest.approx(1.96 * 0.025, rel=0.02), pytest.approx(-1.96 * 0.025, rel=0.02))
    known, _ = linear_fit((0.3, 0.08, 0.05, 0.0), np.diag([1e4, 1e4, 1e4, 1e6]))
    for shift in shifts_without(space, known, [Z], blocks):
        assert all(abs(by) < 0.005 for by in shift.values()) and Z not in shift
