"""What may stand in for several members of a set at once: the masses of two links for a payload."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from oracles.arms import SERVOS, arm_xml, random_start, robot_of, settings_of

from residual_mpc.diagnosis.data.dataset import build_dataset
from residual_mpc.diagnosis.data.gap import measure_scales
from residual_mpc.diagnosis.fit.least_squares import fit_all
from residual_mpc.diagnosis.predict.candidates import build_space
from residual_mpc.diagnosis.predict.problem import Problem, build_problem
from residual_mpc.diagnosis.search.settings import SearchSettings
from residual_mpc.diagnosis.search.stand_ins import stand_ins
from residual_mpc.logs.run import Run
from residual_mpc.models.protocol import Drive
from residual_mpc.models.settings import Knob, Term

MASS = 0.3  # kg at the tool
LINKS = (Term("link_mass", "upper"), Term("link_mass", "lower"))


@pytest.fixture
def problem(tmp_path: Path) -> Problem:
    """Of a run of 8 s in which the arm carries a load."""
    robot, seconds, held = robot_of(tmp_path, arm_xml(SERVOS)), 8.0, 10
    t = robot.step * np.arange(round(seconds / robot.step))
    waves = np.stack([0.6 * np.sin(2.1 * t), 0.5 * np.sin(3.3 * t + 1.0)], axis=1)
    command = np.repeat(waves[::held], held, axis=0)[: len(t)]
    drive = Drive(robot.step, 0, command[None], None, np.zeros(1))
    start = {k: 0.0 * v for k, v in random_start(robot, 1).items()}
    settings = settings_of(robot, {("payload", None, "mass"): MASS})
    came = robot.replay(start, drive, settings, ("position.j1", "position.j2"))
    rng = np.random.default_rng(0)
    columns = {c: came[c][0, :-1:held] + 1e-3 * rng.standard_normal(len(t) // held) for c in came}
    columns |= {f"command.j{k + 1}": waves[::held, k] for k in range(2)}
    data = build_dataset([Run("run", t[::held], columns)], [robot], {})
    space = build_space(data, (), ("link_mass", "payload", "coulomb_friction", "base_tilt"))
    return build_problem(data, space, data.sigma, measure_scales(data).motion)


def test_masses_of_two_links_may_stand_for_a_payload(problem: Problem) -> None:
    values = {
        Knob(*t[:2], p): v for t, m in zip(LINKS, (0.05, 0.2), strict=True) for p, v in (("mass", m), ("com", 0.02))
    }
    fit, rest = fit_all(problem, [values, {}], 2)
    starts = stand_ins(problem, rest, fit, LINKS, SearchSettings())
    mass = Knob("payload", None, "mass")
    assert any(start.get(mass, 0.0) == pytest.approx(MASS, rel=0.2) for start in starts)
    assert all(k.target is None for start in starts for k in start if k not in rest.values)


def test_one_effect_on_all_targets_stands_for_what_has_such_a_form(problem: Problem) -> None:
    """The frictions of two joints may be one for all, and nothing else is tried in their place."""
    joints = (Term("coulomb_friction", "j1"), Term("coulomb_friction", "j2"))
    fit, rest = fit_all(problem, [{Knob(*t[:2], "torque"): 0.1 for t in joints}, {}], 0)
    (start,) = stand_ins(problem, rest, fit, joints, SearchSettings())
    assert start == {Knob("coulomb_friction", None, "torque"): pytest.approx(0.1)}


def test_what_imitates_a_mass_begins_with_the_same_mass(problem: Problem) -> None:
    """A probe of another size may be so heavy that predictions diverge."""
    for one, other in ((LINKS[1], Term("payload", None)), (Term("payload", None), LINKS[1])):
        found = {Knob(one.effect, one.target, "mass"): 0.0123}
        fit, rest = fit_all(problem, [found, {}], 0)
        starts = stand_ins(problem, rest, fit, (one,), SearchSettings())
        masses = [start.get(Knob(other.effect, other.target, "mass")) for start in starts]
        assert pytest.approx(0.0123) in masses
        assert all(k.term != one for start in starts for k in start if k.parameter == "mass")
