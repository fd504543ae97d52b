"""What could stand in place of a change, and how likely each is."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from oracles.rover_log import SIGMA, rover_run

from plants.diff_drive import DiffDrive
from residual_mpc.comparison import named, rivals
from residual_mpc.comparison.likelihood import Explanation
from residual_mpc.comparison.named import may_be_none
from residual_mpc.comparison.records import Predicted
from residual_mpc.comparison.rivals import ChangeRivals, _alone_as_good, _hardly_told, _in_place_of, find_change_rivals
from residual_mpc.comparison.search import FoundChange, FoundChanges, search_changes
from residual_mpc.comparison.sets import cut, units_of
from residual_mpc.comparison.settings import ComparisonSettings
from residual_mpc.comparison.space import change_space
from residual_mpc.comparison.units import build_units
from residual_mpc.diagnosis.predict.candidates import build_space
from residual_mpc.diagnosis.predict.problem import build_problem
from residual_mpc.models.settings import Knob, Term

ROVER = DiffDrive("rover", 0.033, 0.16)
LATE, LATE_READINGS = Term("command_delay", None, True), Term("sensor_delay", None, True)
LIMIT, LIMIT_OF_ONE = Term("saturation", None, True), Term("saturation", "left", True)


def test_a_changed_delay_is_in_a_group_with_that_of_the_readings_whichever_both_sets_have() -> None:
    """Both sets are late and the later one more so: what both have is taken for a delay of the readings."""
    sets = [[rover_run(f"{i}{k}", {"command_delay": {"delay": delay}}, 12.0, seed=10 * i + k) for k in range(3)]
            for i, delay in enumerate((0.04, 0.12))]  # fmt: skip
    settings = ComparisonSettings()
    two = cut(sets[0], sets[1], [ROVER] * 6, SIGMA, 1.0, settings.results.data)
    space = change_space(build_space(two.clean, (), ("command_delay", "sensor_delay")))
    problem = build_problem(two.clean, space, two.clean.sigma, two.scales.motion)
    number = units_of(two.clean, two.later, settings.contrast)
    units = build_units(number, two.side(two.clean), two.clean.run, np.zeros((two.clean.count, 1)))
    found = search_changes(problem, {Knob("sensor_delay", None, "delay"): 0.04}, units, settings)
    told = find_change_rivals(problem, found, units, settings)
    assert told.groups == (((LATE,), (LATE_READINGS,)),)
    assert told.shares[LATE] == told.shares[LATE_READINGS] == 0.5


@pytest.mark.parametrize(
    ("one", "ratio", "expected"),
    [(LATE_READINGS, 1e6, True), (Term("actuator_lag", None, True), 19.0, True), (LIMIT, 1.0, False),
     (Term("actuator_lag", None, True), 21.0, False)],
)  # fmt: skip
def test_imitations_need_a_larger_ratio_and_twins_are_never_told_apart(one: Term, ratio: float, expected: bool) -> None:
    twins = {LATE, LATE_READINGS}
    problem: Any = SimpleNamespace(space=SimpleNamespace(are_twins=lambda a, b: {a, b} == twins))
    assert _hardly_told(problem, one, LATE, ratio, ComparisonSettings()) is expected


@pytest.mark.parametrize(("target", "ratio", "expected"), [("j2", 19.0, True), ("j2", 21.0, False), ("j1", 1.0, False)])
def test_a_weaker_servo_and_a_spring_behind_it_are_hard_to_tell_apart(
    target: str, ratio: float, expected: bool
) -> None:
    problem: Any = SimpleNamespace(space=SimpleNamespace(are_twins=lambda a, b: False))
    weaker, spring = Term("actuator_gain", target, True), Term("joint_compliance", "j2", True)
    assert _hardly_told(problem, weaker, spring, ratio, ComparisonSettings()) is expected


def test_an_effect_on_all_targets_speaks_for_the_one_that_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """Only one of the two limits is ever reached."""
    fit: Any = SimpleNamespace(values={}, cost=1.0)
    changes, account = (FoundChange(LIMIT_OF_ONE, 0.0),), SimpleNamespace(cost=3.0)
    found: Any = SimpleNamespace(changes=changes, fit=fit, account=account, phi=1.0)
    fits = {t: (Explanation(LIMIT_OF_ONE, fit, np.ones(1)), Explanation(t, fit, np.ones(1))) for t in (LIMIT, LATE)}
    ratios = {LIMIT: 0.0, LATE: 2.0}
    monkeypatch.setattr(rivals, "_without", lambda _, found, aside, __: found)
    monkeypatch.setattr(rivals, "_in_place_of", lambda *_: fits)
    monkeypatch.setattr(
        rivals, "likelihood_ratios", lambda problem, pair, *_: np.array([[0.0, ratios[pair[1].term]], [0.0, 0.0]])
    )
    problem: Any = SimpleNamespace(space=SimpleNamespace(are_twins=lambda *_: False))
    shares = find_change_rivals(problem, found, Any, ComparisonSettings()).shares
    other = np.exp(-1.0)
    assert shares[LIMIT_OF_ONE] == pytest.approx(2.0 / (2.0 + other))
    assert shares[LIMIT] == pytest.approx(1.0 / (2.0 + other)) and shares[LATE] == pytest.approx(other / (2.0 + other))


@pytest.mark.parametrize(("cost", "expected"), [(1005.0, (LATE,)), (1500.0, None)])
def test_one_change_that_explains_as_much_as_several_takes_their_place(
    cost: float, expected: tuple[Term, ...] | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As much, save what a change has to explain to be named at all."""
    lag, own = Term("actuator_lag", None, True), Knob("command_delay", None, "delay")
    foreign = Knob("track_width", None, "scale")  # an error of both sets that came from another rival
    values = {Knob(t.effect, None, p, True): 0.1 for t, p in ((LATE, "delay"), (LIMIT, "limit"))}
    fit: Any = SimpleNamespace(cost=1000.0, knobs=(1, 2), values={})
    rival: Any = SimpleNamespace(values={**values, own: 0.2, foreign: 1.1})
    found = FoundChanges(fit, fit, (FoundChange(lag, 0.001), FoundChange(LIMIT, 0.002)), Any, 2.0)
    fitted: list[Any] = []

    def fit_all(problem: Any, starts: Any, **_: Any) -> list[Any]:
        fitted.extend(starts)
        return [SimpleNamespace(cost=cost, knobs=(1, 2), values=v) for v in starts]

    monkeypatch.setattr(rivals, "fit_all", fit_all)
    fits = {LATE: (Explanation(lag, fit, np.ones(1)), Explanation(LATE, rival, np.ones(1)))}
    units: Any = SimpleNamespace(count=12)
    alone = _alone_as_good(Any, found, found.changes[0], fits, {lag: 0.0, LATE: 3.0}, units, ComparisonSettings())
    assert (None if alone is None else tuple(c.term for c in alone.changes)) == expected
    assert set(fitted[0]) == {Knob("command_delay", None, "delay", True), own}
    assert _alone_as_good(Any, found, found.changes[0], fits, {LATE: 21.0}, units, ComparisonSettings()) is None


@pytest.mark.parametrize(
    ("part", "p", "by_fit", "intervals_with_none", "expected"),
    [(0.01, 0.02, 1.0, (True,), True), (0.01, 0.02, 1.0, (True, False), False),
     (0.2, 0.005, 1.0, (True,), False), (0.2, 0.02, 1.0, (True,), True), (0.01, 0.02, 1.0, (False,), False),
     (0.9, 0.09, 1.0, (True,), True), (0.9, 0.09, 1.0, (False,), False), (0.9, 0.09, 1e-3, (True,), False)],
)  # fmt: skip
def test_a_faint_or_insignificant_change_without_size_is_dropped(
    part: float, p: float, by_fit: float, intervals_with_none: tuple[bool, ...], expected: bool,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    numbers = [SimpleNamespace(may_be_none=holds) for holds in intervals_with_none]
    monkeypatch.setattr(named, "changed_numbers", lambda *_: numbers)
    monkeypatch.setattr(named, "least_half", lambda *_: 0.0)
    of: Any = SimpleNamespace(parts={LATE: part})
    found = FoundChange(LATE, p, by_fit)
    assert may_be_none(Any, Any, found, of, Any, ComparisonSettings()) is expected


def test_what_was_a_rival_of_a_dropped_change_is_a_candidate_no_more() -> None:
    kept, dropped = FoundChange(LATE, 0.001), FoundChange(LIMIT, 0.06)
    found: Any = SimpleNamespace(changes=(kept, dropped))
    places = {LATE: {LATE: 0.6, LATE_READINGS: 0.4}, LIMIT: {LIMIT: 1.0, LATE_READINGS: 0.5}}
    told = ChangeRivals(found, (((LATE,), (LATE_READINGS,)), ((LIMIT,),)), places, {LATE: 0.9, LIMIT: 0.01})
    assert told.shares == {LATE: 0.6, LATE_READINGS: 0.5, LIMIT: 1.0}
    left = told.of(SimpleNamespace(changes=(kept,)))  # type: ignore[arg-type]
    assert left.shares == places[LATE] and left.groups == (((LATE,), (LATE_READINGS,)),)


@pytest.mark.parametrize(
    ("p", "by_fit", "sure", "expected"),
    [(0.9, 1e-4, 0.97, 0.45), (0.9, 0.95, 0.97, 0.0767), (0.1, 1e-4, 0.97, 0.5967), (0.01, 1.0, 0.97, 0.8621),
     (0.01, 1e-4, 0.0, 0.0)],  # where all changes together explain nothing
)  # fmt: skip
def test_a_change_that_only_its_fit_shows_is_no_more_than_possible(
    p: float, by_fit: float, sure: float, expected: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    sized = SimpleNamespace(note="", may_be_none=False)
    monkeypatch.setattr(named, "changed_numbers", lambda *_: (sized,))
    monkeypatch.setattr(named, "least_half", lambda *_: 0.0)
    found: Any = SimpleNamespace(changes=(FoundChange(LATE, p, by_fit),))
    told: Any = SimpleNamespace(found=found, parts={LATE: 1.0}, shares={LATE: 1.0})
    problem: Any = SimpleNamespace(space=SimpleNamespace(slots={LATE.effect: ()}))
    (change,) = named.named_changes(problem, Any, told, Any, {}, sure, ComparisonSettings())
    assert change.probability == pytest.approx(expected, rel=1e-3)
    found.changes = (FoundChange(LATE, p, by_fit, by_fit_alone=True),)
    (change,) = named.named_changes(problem, Any, told, Any, {}, sure, ComparisonSettings())
    assert change.probability == pytest.approx(min(expected, 0.45), rel=1e-3)


def test_windows_that_no_fit_has_seen_make_a_significant_change_more_probable(monkeypatch: pytest.MonkeyPatch) -> None:
    """By as much as they fit better with it; one that its own test does not show gains nothing."""
    sized = SimpleNamespace(note="", may_be_none=False)
    monkeypatch.setattr(named, "changed_numbers", lambda *_: (sized,))
    monkeypatch.setattr(named, "least_half", lambda *_: 0.0)
    problem: Any = SimpleNamespace(space=SimpleNamespace(slots={LATE.effect: ()}))

    def probability(p: float, z: float) -> float:
        found: Any = SimpleNamespace(changes=(FoundChange(LATE, p, 1.0),))
        told: Any = SimpleNamespace(found=found, parts={LATE: 1.0}, shares={LATE: 1.0})
        predicted = {LATE: Predicted(z * 0.01, 0.01, 0.5)}
        return named.named_changes(problem, Any, told, Any, predicted, 0.97, ComparisonSettings())[0].probability

    assert probability(0.03, 3.5) > 0.96 > 0.8 > probability(0.03, 1.3) > 0.7
    assert probability(0.001, 0.5) > 0.94
    assert probability(0.2, 3.5) < 0.55


def test_what_serves_as_well_on_both_sets_is_no_rival_of_a_change(monkeypatch: pytest.MonkeyPatch) -> None:
    """It mends an error of the model: a limit that both sets have explains more than the gain that changed."""
    gain, limit, lag = (Term(e, None, changed=True) for e in ("actuator_gain", "shared_limit", "actuator_lag"))

    def fitted(*given: Any) -> list[Any]:
        ends = ((limit, 5.0, -3.0), (lag, 9.0, 2.0))
        return [SimpleNamespace(lead=SimpleNamespace(term=t), fit=SimpleNamespace(cost=c), drop=d) for t, c, d in ends]

    def beside(problem: Any, fit: Any, change: Term, term: Term, its: Any, settings: Any) -> tuple[Any, Any]:
        return tuple(Explanation(t, its, np.ones(4)) for t in (change, term))  # type: ignore[return-value]

    told = SimpleNamespace(told=[])
    monkeypatch.setattr(rivals, "told_apart", lambda *given: told)
    monkeypatch.setattr(rivals, "fitted_leads", fitted)
    monkeypatch.setattr(rivals, "_twins_of", lambda *given: {})
    monkeypatch.setattr(rivals, "_beside_same_errors", beside)
    fit: Any = SimpleNamespace(values={})
    found = _in_place_of(None, fit, gain, fit, None, ComparisonSettings())  # type: ignore[arg-type]
    assert set(found) == {lag}
