"""A change is judged by what it explains alone, and not by what the effect explains on both sets."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from oracles.rover_log import SIGMA, rover_run

from plants.diff_drive import DiffDrive
from residual_mpc.comparison import search
from residual_mpc.comparison.contrast import Contrast, Contrasts
from residual_mpc.comparison.leads import FittedLead, fitted_leads, p_of_fit, with_change
from residual_mpc.comparison.likelihood import left_beside, likelihood_ratios
from residual_mpc.comparison.rivals import _beside_same_errors
from residual_mpc.comparison.search import FoundChanges, _all_far_worse, _dominant, search_changes
from residual_mpc.comparison.sets import cut, units_of
from residual_mpc.comparison.settings import ComparisonSettings
from residual_mpc.comparison.space import change_space
from residual_mpc.comparison.units import Units, build_units
from residual_mpc.diagnosis.fit.least_squares import Fit, fit_all
from residual_mpc.diagnosis.predict.candidates import build_space
from residual_mpc.diagnosis.predict.problem import Problem, build_problem, part_of
from residual_mpc.models.settings import Knob, Term

ROVER = DiffDrive("rover", 0.033, 0.16)
DELAY, LIMIT, LAG = (Term(effect, None, True) for effect in ("command_delay", "saturation", "actuator_lag"))
PROBES = {DELAY: ("delay", 0.05), LIMIT: ("limit", 5.0), LAG: ("time_constant", 0.05)}


def fitted(
    before: dict[str, dict[str, float]], after: dict[str, dict[str, float]], of: tuple[Term, ...] = (DELAY, LIMIT)
) -> tuple[Problem, Units, dict[Term, FittedLead]]:
    """Changes, each fitted in an account that lacks all effects, with the stretches of the runs."""
    sets = [[rover_run(f"{name}{k}", effects, 12.0, seed=10 * i + k) for k in range(3)]
            for i, (name, effects) in enumerate((("before", before), ("after", after)))]  # fmt: skip
    settings = ComparisonSettings()
    two = cut(sets[0], sets[1], [ROVER] * 6, SIGMA, 1.0, settings.results.data)
    data = two.clean
    space = change_space(build_space(data, (), tuple(term.effect for term in of)))
    problem = build_problem(data, space, data.sigma, two.scales.motion)
    current = fit_all(problem, [{}], settings=settings.results.fit)[0]
    probes = {term: {Knob(*term[:2], PROBES[term][0], True): PROBES[term][1]} for term in of}
    leads = [Contrast(term, probe, 1.0, 1.0, 1.0, 5.0, 1e-3, 0.1) for term, probe in probes.items()]
    found = {one.lead.term: one for one in fitted_leads(problem, current, leads, settings)}
    number = units_of(data, two.later, settings.contrast)
    return problem, build_units(number, two.side(data), data.run, np.zeros((data.count, 1))), found


Fitted = tuple[Problem, Units, dict[Term, FittedLead]]


@pytest.fixture(scope="module")
def limited() -> Fitted:
    """The later set has a limit."""
    return fitted({}, {"saturation": {"limit": 4.0}})


@pytest.fixture(scope="module")
def delayed() -> Fitted:
    """The later set has a delay."""
    return fitted({}, {"command_delay": {"delay": 0.12}})


def drops(of: Fitted) -> dict[Term, float]:
    """By how much either change lowers the cost."""
    return {term: one.drop for term, one in of[2].items()}


def test_what_both_sets_have_is_no_change() -> None:
    """The later runs fit better with a limit of their own, but as well with one that both sets have."""
    both = {"saturation": {"limit": 4.0}}
    found = drops(fitted(both, both))
    assert found[LIMIT] < 0.0


def test_what_one_set_has_is_one(limited: Fitted) -> None:
    found = drops(limited)
    assert found[LIMIT] > 1000.0 and found[LIMIT] > 3.0 * found[DELAY]


def test_a_factor_that_is_to_become_small_starts_above_its_bound(limited: Fitted) -> None:
    """For every probe. A linear extrapolation from the last two would be negative."""
    problem, _, _ = limited
    term = Term("track_width", None, True)
    for probe, dose in ((0.8, 4.1), (1.25, -5.1), (2.0, -2.0)):
        lead = Contrast(term, {Knob(*term[:2], "scale", True): probe}, 0.3, dose, 1.0, 5.0, 1e-3, 0.1)
        start = with_change(problem, {}, lead)
        assert 0.2 < start[Knob(*term[:2], "scale", True)] < 0.5 and 0.9 < start[Knob(*term[:2], "scale")] < 1.3
    delay = Contrast(DELAY, {Knob(*DELAY[:2], "delay", True): 0.05}, 0.0, 1.5, 1.0, 5.0, 1e-3, 0.1)
    assert np.isclose(with_change(problem, {}, delay)[Knob(*DELAY[:2], "delay", True)], 0.075)


def test_the_choice_between_changes_may_be_made_on_fewer_windows(limited: Fitted) -> None:
    problem, units, _ = limited
    keep = np.arange(problem.data.count) % 3 == 0
    few = part_of(problem, keep)
    some = build_units(units.number[keep], units.later[units.number[keep]], few.data.run, np.zeros((keep.sum(), 1)))
    whole, quick = (search_changes(problem, {}, units, ComparisonSettings(), None, c) for c in (None, (few, some)))
    assert [c.term for c in quick.changes] == [c.term for c in whole.changes] == [LIMIT]
    assert len(quick.fit.r) == problem.data.count and abs(quick.fit.cost - whole.fit.cost) < 0.01 * whole.fit.cost


def test_the_likelihood_ratio_is_in_favour_of_what_changed(limited: Fitted) -> None:
    problem, units, found = limited
    ratios = likelihood_ratios(
        problem, [found[t].explanation for t in (LIMIT, DELAY)], units, 1.0, ComparisonSettings().contrast
    )
    assert ratios[0, 1] > 20.0
    np.testing.assert_allclose(ratios, -ratios.T)


def test_a_change_that_is_there_leaves_its_imitation_less_than_it_leaves_the_change(delayed: Fitted) -> None:
    problem, units, found = delayed
    explained = [found[t].explanation for t in (DELAY, LIMIT)]
    left = left_beside(problem, explained, units, ComparisonSettings().contrast)
    assert left[0, 1] < left[1, 0] and left[1, 0] > 2.0
    assert (np.diag(left) == 0.0).all()


def test_stretches_with_large_errors_do_not_decide_between_changes(delayed: Fitted) -> None:
    """The drops of the cost are made equal by two stretches with large errors; the test still tells the delay."""
    problem, units, found = delayed
    delay, limit = (found[t].explanation for t in (DELAY, LIMIT))
    worst = np.isin(units.number, np.flatnonzero(units.later)[:2])
    lacking = float((delay.dropped - limit.dropped).sum())
    limit = replace(limit, dropped=limit.dropped + np.where(worst, lacking / worst.sum(), 0.0))
    ratios = likelihood_ratios(problem, [delay, limit], units, 1e3, ComparisonSettings().contrast)
    assert ratios[0, 1] > 4.0


def test_a_change_with_more_parameters_has_to_explain_more(limited: Fitted) -> None:
    """The same fit with one parameter more, which does nothing, loses by the correction of Schwarz."""
    problem, units, found = limited
    limit, delay = (found[t].explanation for t in (LIMIT, DELAY))
    knobs = (*limit.fit.knobs, Knob("payload", None, "mass", True))
    idle = np.concatenate([limit.fit.jacobian, np.zeros_like(limit.fit.jacobian[..., :1])], axis=-1)
    more = replace(limit, fit=replace(limit.fit, knobs=knobs, jacobian=idle))
    contrast = ComparisonSettings().contrast
    fewer, padded = (likelihood_ratios(problem, [x, delay], units, 100.0, contrast)[0, 1] for x in (limit, more))
    assert 0.0 < padded < fewer


def test_two_effects_that_do_the_same_are_not_told_apart(limited: Fitted) -> None:
    """As a radius and a track, where only the turning is measured: a common error of its own does not decide."""
    problem, units, found = limited
    limit = found[LIMIT].explanation
    knobs = (*limit.fit.knobs, Knob("payload", None, "mass"))
    idle = np.concatenate([limit.fit.jacobian, np.zeros_like(limit.fit.jacobian[..., :1])], axis=-1)
    twin = replace(limit, fit=replace(limit.fit, knobs=knobs, jacobian=idle, cost=limit.fit.cost - 1.0),
                   dropped=limit.dropped * (1.0 - 1e-6))  # fmt: skip
    ratios = likelihood_ratios(problem, [limit, twin], units, 100.0, ComparisonSettings().contrast)
    assert abs(ratios[0, 1]) < 1.0


def test_costs_that_contradict_each_other_decide_nothing(limited: Fitted) -> None:
    """One change leaves less, the other explains more beyond its effect on both sets: the test alone decides."""
    problem, units, found = limited
    limit, delay = (found[t].explanation for t in (LIMIT, DELAY))
    boasting = replace(delay, dropped=10.0 * limit.dropped)
    contrast = ComparisonSettings().contrast
    left = left_beside(problem, [limit, boasting], units, contrast) ** 2
    ratios = likelihood_ratios(problem, [limit, boasting], units, 1.0, contrast)
    np.testing.assert_allclose(ratios, left.T - left)


def test_an_error_of_the_model_speaks_for_no_change() -> None:
    """Both sets have a lag that the model lacks, and the later one a delay as well: a lag as the change brings one on
    both sets along, which a delay lacks until both are compared beside the same errors."""
    lag = {"actuator_lag": {"time_constant": 0.15}}
    problem, _, found = fitted(lag, {**lag, "command_delay": {"delay": 0.03}}, (DELAY, LAG))
    alone = {term: one.explanation for term, one in found.items()}
    assert alone[LAG].fit.cost < alone[DELAY].fit.cost
    late, slow = _beside_same_errors(problem, found[DELAY].fit, DELAY, LAG, found[LAG].fit, ComparisonSettings())
    assert (late.term, slow.term) == (DELAY, LAG)
    both = {k for k in late.fit.knobs if not k.changed}
    assert both == {k for k in slow.fit.knobs if not k.changed} and len(both) == 2
    assert late.fit.cost < 0.7 * slow.fit.cost
    np.testing.assert_allclose(late.dropped - slow.dropped, slow.fit.per_window - late.fit.per_window)


def left_by(*squares: float) -> tuple[Any, Units]:
    """A fit that leaves these mean squares of four runs of two stretches, the last two of the later set."""
    run = np.repeat(np.arange(4), 2)
    r = np.sqrt(np.array(squares))[run][:, None] * np.ones((8, 5))
    fit = SimpleNamespace(r=r, per_window=np.sum(r**2, axis=1))
    return fit, Units(np.arange(8), run > 1, run, np.zeros((8, 1)))


def test_every_later_run_has_to_fit_far_worse_than_every_run_before() -> None:
    settings = ComparisonSettings()
    assert _all_far_worse(*left_by(0.1, 0.2, 0.9, 5.0), settings)
    assert not _all_far_worse(*left_by(0.1, 0.2, 0.7, 5.0), settings)
    assert not _all_far_worse(*left_by(0.1, 0.2, 0.3, 90.0), settings)
    assert not _all_far_worse(*left_by(0.1, 9.0, 10.0, 11.0), settings)


def test_the_search_begins_again_from_the_account_of_the_runs_before(
    monkeypatch: pytest.MonkeyPatch, limited: Fitted
) -> None:
    """Only where nothing was found and every later run fits far worse than those before."""
    problem, units, _ = limited
    account = {Knob("actuator_lag", None, "time_constant"): 0.03}
    begun: list[float] = []

    def nothing(problem: Problem, base: Fit, current: Fit, *rest: Any) -> FoundChanges:
        begun.append(base.values[Knob("actuator_lag", None, "time_constant")])
        return FoundChanges(current, base, (), Contrasts((), 1.0), 1.0)

    monkeypatch.setattr(search, "_forward", nothing)
    for worse, count in ((False, 1), (True, 2)):
        begun.clear()
        monkeypatch.setattr(search, "_all_far_worse", lambda *args, worse=worse: worse)
        assert search_changes(problem, account, units, ComparisonSettings()).changes == ()
        assert len(begun) == count and begun[0] != 0.03 and begun[1:] == [0.03] * (count - 1)


@pytest.mark.slow
def test_a_change_that_explains_much_is_no_chance_even_where_no_probe_shows_it() -> None:
    """The probability follows from the drop that the fit reached, with runs as observations."""
    _, units, found = fitted({}, {"command_delay": {"delay": 0.1}})
    one = found[DELAY]
    assert p_of_fit(one, 1.0, units, 40) < 1e-3
    assert p_of_fit(one, one.drop, units, 40) == 1.0  # a drop of one degree of freedom
    few = build_units(units.run, units.later[: units.count], units.run, np.zeros((units.count, 1)))
    two = replace(few, run=np.minimum(few.run, 1))
    assert p_of_fit(one, 1.0, two, 40) == 1.0  # two runs differ in everything


@pytest.mark.parametrize(
    ("predicted", "reached", "found"),
    [(60.0, 60.0, True), (40.0, 60.0, False), (60.0, 40.0, False), (90.0, -1.0, False)],
)
def test_what_removes_most_of_the_cost_is_fitted_where_no_test_is_significant(
    predicted: float, reached: float, found: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a cost of 100, in 16 stretches of eight runs: the drop that is predicted and the one that is reached have to
    be more than half of it."""
    run = np.repeat(np.arange(8), 2)
    units = Units(np.arange(16), run > 3, run, np.zeros((16, 1)))
    lead = Contrast(LIMIT, {Knob("saturation", None, "limit", True): 5.0}, 0.0, 1.0, predicted, 1.5, 0.3, 0.1)
    fit = SimpleNamespace(knobs=tuple(lead.probe), cost=100.0 - reached)
    common = SimpleNamespace(cost=100.0)
    monkeypatch.setattr(search, "fitted_leads", lambda *given: [FittedLead(lead, fit, common)])  # type: ignore[arg-type]
    monkeypatch.setattr(search, "dispersion", lambda *given: 0.5)
    current: Any = SimpleNamespace(cost=100.0)
    best = _dominant(Any, current, units, [lead], 0.01, ComparisonSettings())
    assert (best is not None) is found
    if best is not None:
        change = best[1]
        assert change.by_fit_alone and change.p == 0.3 and change.by_fit < 0.01
    monkeypatch.setattr(search, "dispersion", lambda *given: 50.0)  # as large as by chance
    assert _dominant(Any, current, units, [lead], 0.01, ComparisonSettings()) is None
