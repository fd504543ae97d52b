"""A gear whose losses grow faster than its load: the share that grows is a number only where the runs show it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from oracles.arms import robot_of

from plants.mujoco_robot.robot import MujocoRobot
from residual_mpc.diagnosis.data.dataset import build_dataset
from residual_mpc.diagnosis.diagnose import diagnose
from residual_mpc.diagnosis.fit.least_squares import fit_all
from residual_mpc.diagnosis.options import Options
from residual_mpc.diagnosis.predict.candidates import build_space
from residual_mpc.diagnosis.predict.problem import build_problem
from residual_mpc.diagnosis.results.document import to_document
from residual_mpc.diagnosis.search.optional_numbers import at_bounds, misplaced, without_nulls
from residual_mpc.diagnosis.search.settings import SearchSettings
from residual_mpc.logs.run import Run
from residual_mpc.models.settings import Knob

MASS, LENGTH, ROTOR, GRAVITY = 0.5, 0.1, 0.002, 9.81  # kg, m, kg m^2, m/s^2
STIFF, DAMP = (0.8, 1.6, 3.2), 0.04  # N m/rad by run, N m s/rad
DT, FINE, SECONDS = 0.01, 2e-4, 8.0  # s
SIGMA = 1e-3  # rad
NOISE = {"position.shaft": SIGMA}
SHARE, QUADRATIC = (Knob("load_dependent_friction", "shaft", p) for p in ("coefficient", "quadratic"))
XML = f"""<mujoco model="servo"><option timestep="0.001" integrator="implicitfast"/><worldbody><body name="arm">
<joint name="shaft" type="hinge" axis="0 1 0" armature="{ROTOR}"/>
<geom type="sphere" size="0.001" pos="0 0 {-LENGTH}" mass="{MASS}" contype="0" conaffinity="0"/>
<site name="load" pos="0 0 {-LENGTH}"/></body></worldbody><actuator>
<position name="servo" joint="shaft" kp="{{kp}}" kv="{DAMP}"/></actuator></mujoco>"""


def loaded_runs(share: float, quadratic: float) -> list[Run]:
    """The truth: a pendulum on a servo, whose gear rubs with share |tau| + quadratic tau^2 N m. Semi-implicit steps of
    0.2 ms; a friction that would turn the motion round stops it."""
    t = DT * np.arange(int(SECONDS / DT) + 1)
    rng = np.random.default_rng(3)
    waves = [(rng.uniform(0.3, 0.6), f, rng.uniform(0, 6)) for f in (0.25, 0.6, 1.3)]
    command = sum(a * np.sin(2 * np.pi * f * t + phase) for a, f, phase in waves) * np.linspace(0.2, 1.5, len(t))
    kp, inertia = np.array(STIFF), MASS * LENGTH**2 + ROTOR
    q, v, seen = np.zeros(len(kp)), np.zeros(len(kp)), []
    for u in command:
        seen.append(q.copy())
        for _ in range(round(DT / FINE)):
            torque = kp * (u - q) - DAMP * v
            rubs = FINE * (share * np.abs(torque) + quadratic * torque**2) / inertia
            free = v + FINE * (torque - MASS * GRAVITY * LENGTH * np.sin(q)) / inertia
            v = np.sign(free) * np.maximum(np.abs(free) - rubs, 0.0)
            q = q + FINE * v
    noisy = np.array(seen) + SIGMA * rng.standard_normal((len(t), len(kp)))
    return [Run(f"r{i}", t, {"command.servo": command, "position.shaft": noisy[:, i]}) for i in range(len(kp))]


def robots_in(folder: Path) -> list[MujocoRobot]:
    for i in range(len(STIFF)):
        (folder / f"{i}").mkdir()
    return [robot_of(folder / f"{i}", XML.format(kp=kp)) for i, kp in enumerate(STIFF)]


def diagnosed(folder: Path, share: float, quadratic: float) -> dict[str, Any]:
    """diagnosis.json, of dry frictions alone."""
    options = Options(only=("load_dependent_friction", "coulomb_friction", "stribeck_friction"))
    runs = loaded_runs(share, quadratic)
    found = diagnose(runs, robots_in(folder), NOISE, (), options, np.random.default_rng(0))
    return to_document(found.diagnosis)


@pytest.mark.parametrize(("share", "quadratic"), [(0.15, 0.35), pytest.param(0.3, 0.0, marks=pytest.mark.slow)])
def test_it_is_named_where_the_runs_show_it(tmp_path: Path, share: float, quadratic: float) -> None:
    document = diagnosed(tmp_path, share, quadratic)
    assert document["verdict"] == "effects"
    (named,) = document["explanation"]
    assert named["effect"] == "load_dependent_friction"
    truth = {"coefficient": share, "quadratic": quadratic} if quadratic else {"coefficient": share}
    assert named["parameters"].keys() == truth.keys()
    for name, value in truth.items():
        low, high = named["parameters"][name]["ci95"]
        assert low < value < high, named["parameters"]


def test_a_number_that_ends_at_none_leaves_the_set_and_not_the_set_the_search(tmp_path: Path) -> None:
    """None is its lower bound; the effect that it belongs to stays."""
    data = build_dataset(loaded_runs(0.3, 0.0), robots_in(tmp_path), NOISE)
    problem, settings = build_problem(data, build_space(data, ()), data.sigma), SearchSettings()
    high = problem.space.bounds(QUADRATIC)[1]
    ends = [{SHARE: 0.3, QUADRATIC: x * high} for x in (0.0, 0.2, 1.0)]
    none, some, most = fit_all(problem, ends, 0, settings=settings.fit)
    assert [at_bounds(problem.space, f) for f in (none, some, most)] == [(QUADRATIC,), (), (QUADRATIC,)]
    assert [misplaced(problem.space, f) for f in (none, some, most)] == [(), (), (QUADRATIC,)]
    fewer, same, still = without_nulls(problem, [none, some, most], settings)
    assert fewer.values.keys() == {SHARE} and same is some and still is most
