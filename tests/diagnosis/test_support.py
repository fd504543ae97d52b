"""What casts doubt on a named effect, and what that does to the other effects' intervals."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from oracles.rover_log import SIGMA, rover_run

from plants.diff_drive import DiffDrive
from residual_mpc.diagnosis.data.dataset import build_dataset
from residual_mpc.diagnosis.diagnose import diagnose
from residual_mpc.diagnosis.fit.least_squares import fit_all
from residual_mpc.diagnosis.options import Options
from residual_mpc.diagnosis.predict.candidates import build_space
from residual_mpc.diagnosis.predict.effect_sets import without
from residual_mpc.diagnosis.predict.problem import build_problem
from residual_mpc.diagnosis.results import readjusted as module
from residual_mpc.diagnosis.results.causes import refitted_without
from residual_mpc.diagnosis.results.readjusted import readjusted
from residual_mpc.diagnosis.results.settings import ResultSettings
from residual_mpc.diagnosis.results.support import Rises, Support, _beside, _size, doubts
from residual_mpc.models.settings import Knob, Term

ROVER = DiffDrive("rover", 0.033, 0.16)
LAG, DELAY = Term("actuator_lag", None), Term("command_delay", None)
TAU, DEAD_TIME = Knob("actuator_lag", None, "time_constant"), Knob("command_delay", None, "delay")


def explained(lag: float, delay: float) -> Any:
    """A fit with both effects to runs whose wheels have a lag alone."""
    faults = {"actuator_lag": {"time_constant": lag}}
    runs = [rover_run(f"r{k}", faults, seed=k) for k in range(2)]
    data = build_dataset(runs, [ROVER] * 2, SIGMA)
    problem = build_problem(data, build_space(data, ()), data.sigma)
    fit = fit_all(problem, [{TAU: lag, DEAD_TIME: delay}], 0)[0]
    return SimpleNamespace(problem=problem, final=fit, tolerated=None, space=problem.space)


@pytest.mark.parametrize(("delay", "size"), [(0.01, 1.0), (0.06, 6.0)])
def test_a_dead_time_counts_beside_the_lag_of_its_actuator(delay: float, size: float) -> None:
    assert _size(explained(0.1, delay), DELAY, settings=ResultSettings()) == pytest.approx(size)


def test_the_fits_without_an_effect_move_the_numbers_of_the_others() -> None:
    of = explained(0.1, 0.03)
    assert refitted_without(of, [DELAY], 20_000, settings=ResultSettings())[TAU][0] == pytest.approx(0.1, abs=0.01)


def test_what_others_make_up_for_is_no_contribution() -> None:
    """A part of a lag that a delay stands for."""
    of = explained(0.1, 0.03)
    of.final = fit_all(of.problem, [{TAU: 0.06, DEAD_TIME: 0.03}], 0)[0]
    less, left = without(of.final.values, DELAY), readjusted(of.problem, of.final)[DELAY]
    assert set(left) == {TAU} and left[TAU] == pytest.approx(0.1, abs=0.02)
    costs = np.sum(of.problem.residuals([less, left]) ** 2, axis=(1, 2))
    assert costs[1] < 0.1 * costs[0]


def test_a_step_that_leads_away_is_not_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "gauss_newton_step", lambda fit, windows, r, free: np.full(len(fit.knobs), 0.5))
    of = explained(0.1, 0.03)
    assert readjusted(of.problem, of.final)[DELAY] == without(of.final.values, DELAY)


@pytest.mark.parametrize(
    ("law", "doubted"),
    [
        ("fitted_law_torque_position", True),
        ("fitted_law_strength_load", True),
        ("fitted_law_torque_command", False),
    ],
)
def test_a_law_leaves_doubt_on_what_would_imitate_it(law: str, doubted: bool) -> None:
    """A gain that is fitted beside a law of the position may stand for a part of what the law describes."""
    gain = Term("actuator_gain", "j1")
    supports = dict.fromkeys((gain, Term(law, "j1")), Support(("fits", "predicts"), 100.0))
    factor = doubts(supports, None, settings=ResultSettings())[gain]
    assert factor == (ResultSettings().support.unsupported if doubted else 1.0)


def test_an_effect_that_rests_on_one_run_is_in_doubt() -> None:
    gain = Term("actuator_gain", "j1")
    certain, fails = Support(("fits", "predicts"), 100.0), Support(("fits", "predicts"), 100.0, fails=True)
    settings = ResultSettings()
    assert doubts({gain: certain}, None, settings=settings)[gain] == 1.0
    assert doubts({gain: fails}, None, settings=settings)[gain] == settings.support.unsupported


@pytest.mark.parametrize(("beside", "factor"), [(0.02, 0.5), (0.03, 0.5), (0.045, 0.75), (0.06, 1.0), (2.0, 1.0)])
def test_what_the_law_of_a_large_effect_may_lack_is_in_doubt(beside: float, factor: float) -> None:
    small, large = Term("coulomb_friction", "j1"), Term("gear_efficiency", "j1")
    supports = {small: Support(("fits", "predicts"), 100.0, beside=beside), large: Support(("fits", "predicts"), 1e6)}
    assert doubts(supports, None, settings=ResultSettings()) == pytest.approx({small: factor, large: 1.0})


def rises(lasting: list[float], only: np.ndarray, none: float) -> Rises:
    """Without an effect, before the others make up for it, the gap rises by far more."""
    return Rises(np.full(len(lasting), 1e5), np.array(lasting), only, none)


def test_an_effect_is_small_beside_another_only_if_it_is_at_every_horizon() -> None:
    apart = np.full(3, 1e4)  # none explains much by itself
    second, longer = rises([4.0, 1e4, -1.0], apart, 1e4), rises([100.0, 1e4, 1.0], apart, 1e4)
    assert [_beside([second, longer], k) for k in range(3)] == pytest.approx([0.1, 50.0, 0.01])
    assert _beside([rises([3.0], np.zeros(1), 3.0)], 0) == np.inf


def test_an_effect_that_imitates_another_is_compared_with_what_that_explains_alone() -> None:
    """A dead zone of a servo beside a dry friction: without either, the other still explains most."""
    dead_zone, friction = 1.0, 200.0
    both = rises([dead_zone, friction], np.array([friction, dead_zone]), 2501.0)
    assert _beside([both], 0) == pytest.approx(0.5 * 0.02)
    assert _beside([both], 1) == pytest.approx(0.5 * (friction / (2501.0 - friction)) ** 0.5)
    apart = rises([1.0, 2500.0], np.array([2500.0, 1.0]), 2501.0)
    assert _beside([apart], 0) == pytest.approx(0.02) and _beside([apart], 1) == pytest.approx(25.0)


def test_an_effect_of_one_run_of_three_is_possible_at_most() -> None:
    """The middle run, the longest, has a track of its own; the other two have none worth naming."""
    runs = [
        rover_run(f"r{k}", {"track_width": {"scale": scale}}, length, seed=k)
        for k, (scale, length) in enumerate([(1.005, 12.0), (1.03, 40.0), (1.005, 12.0)])
    ]
    options = Options(only=("track_width",))
    made = diagnose(runs, [ROVER] * 3, {}, (), options, np.random.default_rng(0)).diagnosis
    (cause,) = made.causes
    assert cause.evidence == ("fits", "predicts") and cause.probability < 0.5
