"""Other sets that explain the runs as well: an effect on the wrong targets, twins, and what nothing resembles."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from oracles.rover_log import SIGMA, rover_run

from plants.diff_drive import DiffDrive
from residual_mpc.diagnosis.data.dataset import build_dataset
from residual_mpc.diagnosis.data.gap import measure_scales
from residual_mpc.diagnosis.data.settings import DataSettings
from residual_mpc.diagnosis.fit.evidence import blocks_of, dispersion, without_the_most_telling
from residual_mpc.diagnosis.fit.least_squares import fit_all
from residual_mpc.diagnosis.fit.settings import FitSettings
from residual_mpc.diagnosis.predict.candidates import build_space
from residual_mpc.diagnosis.predict.prediction_cache import PredictionCache
from residual_mpc.diagnosis.predict.problem import build_problem
from residual_mpc.diagnosis.search import rivals, screen, stand_ins
from residual_mpc.diagnosis.search.acceptance import Ruler, build_ruler, judge
from residual_mpc.diagnosis.search.close_rivals import Rival, too_close
from residual_mpc.diagnosis.search.rivals import (
    Rivalry,
    _beside_the_better_values,
    _fits,
    _replacements,
    _shares,
    _without_needless,
    find_rivals,
    holds_elsewhere,
)
from residual_mpc.diagnosis.search.screen import ScreenedTerm
from residual_mpc.diagnosis.search.settings import SearchSettings
from residual_mpc.diagnosis.search.stepwise import Found
from residual_mpc.diagnosis.search.visible_gaps import told_over, with_gaps_seen
from residual_mpc.logs.run import Run
from residual_mpc.models.settings import Knob, Term, Values

ROVER = DiffDrive("rover", 0.033, 0.16)
BOTH, LEFT = Term("actuator_gain", None), Term("actuator_gain", "left")


def run_of(faults: dict[str, dict[str, float]], left: float, seed: int) -> Run:
    """left: the gain of the left wheel alone; what was sent to it is what it did by this."""
    run = rover_run(f"r{seed}", faults, seed=seed)
    return Run(run.name, run.t, {**run.columns, "command.left": run.columns["command.left"] / left})


def rivals_of(faults: dict[str, dict[str, float]], chosen: Values, only: tuple[str, ...], left: float = 1.0) -> Rivalry:
    """What is found where a search has ended with `chosen`."""
    return find_rivals(found_of(faults, chosen, only, left), settings=SearchSettings())


def found_of(faults: dict[str, dict[str, float]], chosen: Values, only: tuple[str, ...], left: float = 1.0) -> Found:
    data = build_dataset([run_of(faults, left, seed) for seed in range(2)], [ROVER] * 2, SIGMA)
    space = build_space(data, (), only)
    scales = measure_scales(data)
    problem = build_problem(data, space, data.sigma, scales.motion)
    noise = 1.0 / problem.weight
    problem = judge(problem, fit_all(problem, [chosen])[0], noise, scales, settings=SearchSettings())
    base, fit = fit_all(problem, [{}, chosen])
    ruler = build_ruler(problem.replays, scales, base, np.random.default_rng(0), DataSettings())
    phi = dispersion(fit, blocks_of(data, settings=FitSettings()))
    return Found(problem, fit, base, phi, ruler, (), (), data.sigma)


def test_an_effect_on_all_targets_is_also_there_on_the_one_that_is_named() -> None:
    """A limit that one joint alone reaches may be that of all joints."""
    fit: Any = SimpleNamespace(terms=(LEFT,))
    delay = Term("command_delay", None)
    rivals = [Rival((LEFT,), (came,), fit, ratio, True) for came, ratio in ((BOTH, 0.0), (delay, 2.0))]
    shares, other = _shares(fit, rivals), float(np.exp(-1.0))
    assert shares[LEFT] == pytest.approx(2.0 / (2.0 + other)) and shares[BOTH] == pytest.approx(1.0 / (2.0 + other))
    assert shares[delay] == pytest.approx(other / (2.0 + other))
    told = [Rival((BOTH,), (LEFT,), fit, 50.0, False)]  # both have it: what is said of one alone is not true
    assert _shares(SimpleNamespace(terms=(BOTH,)), told)[LEFT] < 1e-9


def test_an_effect_that_a_rival_makes_needless_competes_with_it() -> None:
    """A payload in place of the mass of one link that leaves nothing to that of another."""
    one, other, load, drag = (
        Term(*t) for t in (("link_mass", "a"), ("link_mass", "b"), ("payload", None), ("coulomb_friction", "a"))
    )
    fit: Any = SimpleNamespace(terms=(one, other, drag))
    leaner: Any = SimpleNamespace(terms=(load, drag))
    shares = _shares(fit, [Rival((one,), (load,), leaner, -2.0, False)])
    assert shares[one] == shares[other] == pytest.approx(0.5)  # a better ratio counts as none
    assert shares[drag] == 1.0


def test_the_first_members_of_two_groups_do_not_compete_with_the_rivals_of_each_other() -> None:
    """Dry friction of two joints, found as Stribeck friction of both, beside a delay that may be a lag: what stands for
    one place says nothing of the others."""
    dry, falling = ([Term(e, joint) for joint in ("a", "b")] for e in ("coulomb_friction", "stribeck_friction"))
    delay, lag = (Term(e, None) for e in ("command_delay", "actuator_lag"))
    found = [*falling, delay]

    def instead(gone: Term, came: Term) -> Rival:
        fit: Any = SimpleNamespace(terms=tuple(came if t == gone else t for t in found))
        return Rival((gone,), (came,), fit, 0.0, True)

    rivals = [instead(f, d) for f, d in zip(falling, dry, strict=True)] + [instead(delay, lag)]
    preferred: Any = SimpleNamespace(terms=(*dry, delay))
    shares = _shares(preferred, rivals)
    assert [shares[t] for t in (*falling, delay, lag)] == [pytest.approx(0.5)] * 4
    assert [shares[t] for t in dry] == [1.0, 1.0]  # Stribeck friction with equal levels is dry friction


def test_an_effect_said_of_both_wheels_goes_to_the_one_that_has_it() -> None:
    found = rivals_of({}, {Knob("actuator_gain", None, "gain"): 0.95}, ("actuator_gain", "track_width"), left=0.9)
    assert found.fit.terms == (LEFT,)
    assert found.fit.values[Knob("actuator_gain", "left", "gain")] == pytest.approx(0.9, abs=0.01)


def test_an_effect_said_of_one_wheel_goes_to_both() -> None:
    found = rivals_of(
        {"actuator_gain": {"gain": 0.9}},
        {Knob("actuator_gain", "left", "gain"): 0.9},
        ("actuator_gain", "track_width"),
    )
    assert BOTH in found.fit.terms and LEFT not in found.fit.terms


def test_an_effect_said_of_each_wheel_goes_to_both() -> None:
    found = rivals_of(
        {"actuator_gain": {"gain": 0.9}},
        {Knob("actuator_gain", "left", "gain"): 0.9, Knob("actuator_gain", "right", "gain"): 0.9},
        ("actuator_gain", "track_width"),
    )
    assert found.fit.terms == (BOTH,)
    assert found.fit.values[Knob("actuator_gain", None, "gain")] == pytest.approx(0.9, abs=0.01)
    assert ((BOTH,), (LEFT, Term("actuator_gain", "right"))) in found.groups


def test_wheels_that_differ_stay_apart() -> None:
    found = rivals_of(
        {"actuator_gain": {"gain": 0.9}},
        {Knob("actuator_gain", "left", "gain"): 0.8, Knob("actuator_gain", "right", "gain"): 0.9},
        ("actuator_gain", "track_width"),
        left=0.9,
    )
    assert set(found.fit.terms) == {LEFT, Term("actuator_gain", "right")}


def test_what_imitates_an_effect_competes_whatever_its_lead_promises(monkeypatch: pytest.MonkeyPatch) -> None:
    """Small differences may take up nearly all that a delay does along the line from none."""

    def glance(*args: Any, **kwargs: Any) -> list[ScreenedTerm]:
        leads = screen.glance(*args, **kwargs)
        return [
            lead if lead.term == lag else replace(lead, gain=1e-3, start=dict.fromkeys(lead.start, 0.0))
            for lead in leads
        ]

    monkeypatch.setattr(stand_ins, "glance", glance)
    monkeypatch.setattr(stand_ins, "_as_pair", lambda *args: [])
    delay, lag = Term("command_delay", None), Term("actuator_lag", None)
    chosen: Values = {Knob("actuator_lag", None, "time_constant"): 0.08}
    found = rivals_of({"command_delay": {"delay": 0.08}}, chosen, (delay.effect, lag.effect, "lateral_slip"))
    assert found.fit.terms == (delay,)
    assert found.fit.values[Knob("command_delay", None, "delay")] == pytest.approx(0.08, abs=0.003)


def test_what_removes_nothing_imitates_no_faint_effect() -> None:
    """Beside gusts a short delay hardly lowers the gap, and neither does an effect that does nothing."""
    delay, lag, skew = (Term(name, None) for name in ("command_delay", "actuator_lag", "clock_skew"))
    truth = {"command_delay": {"delay": 0.01}, "gusts": {"size": 0.3}}
    found = found_of(truth, {Knob(*delay[:2], "delay"): 0.01}, (delay.effect, lag.effect, skew.effect))
    idle, other = fit_all(found.problem, [{Knob(*skew[:2], "rate"): 0.0}, {Knob(*lag[:2], "time_constant"): 0.01}], 0)
    rivals = [Rival((delay,), (came,), fit, 10.0, False) for came, fit in ((skew, idle), (lag, other))]
    assert too_close(found.problem, found.ruler, found.fit, rivals, SearchSettings()) == [False, True]


@pytest.mark.parametrize("twins", [True, False])
def test_a_twin_that_fits_nearly_as_well_is_close_whatever_the_likelihood_says(twins: bool) -> None:
    """Small noise in long runs makes a likelihood ratio of any size out of how a delay is rounded to steps."""
    delay, lag = Term("command_delay", None), Term("actuator_lag", None)
    truth = {"command_delay": {"delay": 0.01}, "gusts": {"size": 0.3}}
    found = found_of(truth, {Knob(*delay[:2], "delay"): 0.01}, (delay.effect, lag.effect))
    (other,) = fit_all(found.problem, [{Knob(*lag[:2], "time_constant"): 0.01}], 0)
    pairs = (frozenset({delay, lag}),) if twins else ()
    problem = replace(found.problem, space=replace(found.problem.space, twins=pairs))
    settings = SearchSettings()
    rival = Rival((delay,), (lag,), other, 2.0 * settings.rivals.far, False)
    assert too_close(problem, found.ruler, found.fit, [rival], settings) == [twins]


@pytest.mark.parametrize(("step", "delay", "close"), [(0.05, 0.01, True), (0.05, 0.2, False), (0.0005, 0.01, False)])
def test_so_is_one_whose_difference_the_time_step_hides(
    step: float, delay: float, close: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A likelihood takes the error of the step for noise; one that leaves a far larger gap is still told apart."""
    late, slow = Term("command_delay", None), Term("actuator_lag", None)
    truth = {"command_delay": {"delay": 0.01}, "gusts": {"size": 0.3}}
    found = found_of(truth, {Knob(*late[:2], "delay"): 0.01}, (late.effect, slow.effect))
    (other,) = fit_all(found.problem, [{Knob(*slow[:2], "time_constant"): delay}], 0)
    settings = SearchSettings()
    rival = Rival((late,), (slow,), other, 2.0 * settings.rivals.far, False)
    monkeypatch.setattr(Ruler, "step_error", lambda ruler, fit: step**2)
    assert too_close(found.problem, found.ruler, found.fit, [rival], settings) == [close]


def test_twins_make_a_group_and_share_the_probability() -> None:
    """From the pose alone a smaller wheel is a weaker motor."""
    found = rivals_of(
        {"actuator_gain": {"gain": 0.9}},
        {Knob("actuator_gain", None, "gain"): 0.9},
        ("actuator_gain", "wheel_radius", "command_delay"),
    )
    (group,) = found.groups
    assert set(group) == {(BOTH,), (Term("wheel_radius", None),)}
    assert found.shares[BOTH] == pytest.approx(0.5, abs=0.05)


def test_so_do_those_whose_fits_differ() -> None:
    """What no run can tell apart is no likelier for a fit of many numbers that has come nearer to its end."""
    late, seen = Term("command_delay", None), Term("sensor_delay", None)
    found = found_of({"command_delay": {"delay": 0.05}}, {Knob(*late[:2], "delay"): 0.05}, (late.effect, seen.effect))
    settings = SearchSettings()
    strict = replace(settings, steps=replace(settings.steps, alike=1e-9))
    for twins in (True, False):
        space = replace(found.problem.space, twins=found.problem.space.twins if twins else ())
        rivalry = find_rivals(replace(found, problem=replace(found.problem, space=space)), settings=strict)
        assert bool(rivalry.groups) == twins
        assert not twins or rivalry.shares[late] == pytest.approx(rivalry.shares[seen])


def test_what_differs_by_less_than_the_time_steps_error_makes_a_group(monkeypatch: pytest.MonkeyPatch) -> None:
    delay, lag = Term("command_delay", None), Term("actuator_lag", None)
    late = (
        {"command_delay": {"delay": 0.02}},
        {Knob("command_delay", None, "delay"): 0.02},
        (delay.effect, lag.effect),
    )
    assert rivals_of(*late).groups == ()
    monkeypatch.setattr(Ruler, "step_error", lambda ruler, fit: 0.5**2)
    assert rivals_of(*late).groups == (((delay,), (lag,)),)
    monkeypatch.setattr(Ruler, "step_error", lambda ruler, fit: 0.001**2)
    assert rivals_of(*late).groups == ()


@pytest.mark.parametrize(("gusts", "apart"), [(0.0, True), (0.3, False)])
def test_what_differs_by_less_than_what_neither_explains_makes_a_group(gusts: float, apart: bool) -> None:
    delay, lag = Term("command_delay", None), Term("actuator_lag", None)
    truth = {"actuator_lag": {"time_constant": 0.03}, "gusts": {"size": gusts}}
    found = rivals_of(truth, {Knob("actuator_lag", None, "time_constant"): 0.03}, (delay.effect, lag.effect))
    assert found.groups == (() if apart else (((delay,), (lag,)),))


def test_what_differs_by_more_stays_apart_beside_what_neither_explains() -> None:
    truth = {"actuator_lag": {"time_constant": 0.4}, "gusts": {"size": 0.3}}
    chosen: Values = {Knob("actuator_lag", None, "time_constant"): 0.4}
    assert rivals_of(truth, chosen, ("command_delay", "actuator_lag")).groups == ()


def test_what_nothing_resembles_stands_alone() -> None:
    found = rivals_of(
        {"track_width": {"scale": 1.2}}, {Knob("track_width", None, "scale"): 1.2}, ("track_width", "command_delay")
    )
    assert found.groups == () and found.shares[Term("track_width", None)] > 0.999


def test_the_rival_that_holds_on_other_windows_is_taken() -> None:
    """A search may end with a set that fits its own windows and no others."""
    found = rivals_of(
        {"actuator_gain": {"gain": 0.9}}, {Knob("actuator_gain", None, "gain"): 0.9}, ("actuator_gain", "wheel_radius")
    )
    data = build_dataset([run_of({"actuator_gain": {"gain": 0.9}}, 1.0, 5)], [ROVER], SIGMA)
    replays = PredictionCache(data, build_space(data, (), ("actuator_gain", "wheel_radius")))
    settings = SearchSettings()
    ruler = Ruler(replays, measure_scales(data), 1e-4, settings.data)
    assert found.rivals and holds_elsewhere(found, (), replays, ruler, settings=settings) is None
    lost = replace(found.fit, values={Knob("actuator_gain", None, "gain"): 0.5})
    better = holds_elsewhere(replace(found, fit=lost), (), replays, ruler, settings=settings)
    assert better is not None and better.terms == (Term("wheel_radius", None),)
    met = (found.rivals[0].fit,)  # a set that the search came across serves as well as a rival
    alone = replace(found, fit=lost, rivals=())
    assert holds_elsewhere(alone, met, replays, ruler, settings=settings) is met[0]
    idle = Knob("actuator_gain", "left", "gain")
    larger = replace(met[0], knobs=(*met[0].knobs, idle), values={**met[0].values, idle: 1.0 + 1e-4})
    both = (larger, met[0])  # of sets that do as well, the one with the fewest numbers
    assert holds_elsewhere(alone, both, replays, ruler, settings=settings) is met[0]
    assert holds_elsewhere(alone, (), replays, ruler, settings=settings) is None
    unseen = replace(ruler, floor=1.0)  # what is left is within the noise
    assert holds_elsewhere(alone, met, replays, unseen, settings=settings) is None


@pytest.mark.parametrize(
    ("own", "other", "told"), [(0.011, 0.03, True), (0.011, 0.02, False), (0.005, 0.014, False), (0.03, 0.055, False)]
)
def test_other_horizons_tell_rivals_apart(own: float, other: float, told: bool) -> None:
    """A rival has to leave a far larger gap there: larger by more than the noise, and than what the fit leaves. own,
    other: squared gaps, at a squared floor of 0.01."""
    lag, delay = Knob("actuator_lag", None, "time_constant"), Knob("command_delay", None, "delay")
    found = found_of({"actuator_lag": {"time_constant": 0.08}}, {lag: 0.08}, ("actuator_lag", "command_delay"))
    (fit,) = fit_all(found.problem, [{delay: 0.08}])
    rival = Rival((lag.term,), (delay.term,), fit, 1.0, True)
    over: Any = SimpleNamespace(squared=lambda _: [other, own], floor=0.01)
    (found_rival,) = told_over(found, found.fit, [rival], [over], settings=SearchSettings())
    assert found_rival.alike is not told and (found_rival.ratio >= 10.0) is told
    assert told_over(found, found.fit, [rival], [], settings=SearchSettings()) == [rival]


@pytest.mark.parametrize(("gap", "alike", "ratio"), [(0.011, False, -9.0), (0.02, True, 0.0), (0.05, False, 10.0)])
def test_a_larger_gap_that_the_time_step_may_make_takes_no_place(
    gap: float, alike: bool, ratio: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Squared gaps beside one of 0.01 at a floor of 0.01, with 0.02 from the time step."""
    lag, delay = Knob("actuator_lag", None, "time_constant"), Knob("command_delay", None, "delay")
    found = found_of({"actuator_lag": {"time_constant": 0.08}}, {lag: 0.08}, ("actuator_lag", "command_delay"))
    (fit,) = fit_all(found.problem, [{delay: 0.08}])
    rival = Rival((lag.term,), (delay.term,), fit, -9.0, False)
    ruler: Any = SimpleNamespace(squared=lambda _: [gap, 0.01], floor=0.01, step_error=lambda _: 0.02)
    (seen,) = with_gaps_seen(replace(found, ruler=ruler), found.fit, [rival], settings=SearchSettings())
    assert (seen.alike, seen.ratio) == (alike, ratio)


def test_the_first_member_of_every_group_stands_in_the_explanation() -> None:
    """Each rival is fitted beside the other members that the search found, not beside those preferred to them."""
    delay, late, gain, radius = (
        Term(name, None) for name in ("command_delay", "sensor_delay", "actuator_gain", "wheel_radius")
    )
    truth = {"command_delay": {"delay": 0.08}, "actuator_gain": {"gain": 0.9}}
    chosen = {Knob(*late[:2], "delay"): 0.08, Knob(*radius[:2], "scale"): 0.9}
    found = found_of(truth, chosen, tuple(t.effect for t in (delay, late, gain, radius)))
    rivalry = find_rivals(found, settings=SearchSettings())
    firsts = {group[0][0] for group in rivalry.groups}
    assert len(firsts) == 2 and firsts != set(found.fit.terms)
    assert set(rivalry.fit.terms) == firsts


@pytest.mark.parametrize(("track", "needless"), [(1.0, True), (1.1, False)])
def test_what_made_up_for_the_wrong_effect_is_dropped_beside_the_right_one(track: float, needless: bool) -> None:
    """The remaining effects are then fitted to convergence."""
    delay, lag = Knob("command_delay", None, "delay"), Knob("actuator_lag", None, "time_constant")
    wide = Knob("track_width", None, "scale")
    truth = {"command_delay": {"delay": 0.08}, "track_width": {"scale": track}}
    found = found_of(truth, {lag: 0.08, wide: track + 0.002}, ("command_delay", "actuator_lag", "track_width"))
    (poor,) = fit_all(found.problem, [{delay: 0.06, wide: track}], 0)
    settings, phi = SearchSettings(), found.phi
    rival = Rival((lag.term,), (delay.term,), poor, 50.0, False)
    leaner = _without_needless(found.problem, found.fit, rival, phi, settings)
    assert (leaner.fit.terms == (delay.term,)) == needless == (leaner is not rival)
    if needless:
        assert leaner.gone == rival.gone and leaner.ratio < 0.0
        assert leaner.fit.values[delay] == pytest.approx(0.08, abs=0.003)
    for other in (replace(rival, alike=True), replace(rival, ratio=400.0)):
        assert _without_needless(found.problem, found.fit, other, phi, settings) is other


def test_a_rough_fit_goes_on_where_its_cost_has_fallen_far(monkeypatch: pytest.MonkeyPatch) -> None:
    fits: list[Any] = [SimpleNamespace(cost=cost, values=i) for i, cost in enumerate((4.0, 6.0))]
    small: Any = SimpleNamespace(residuals=lambda rows: np.full((2, 1, 1), 10.0))  # a cost of 100 at the start
    monkeypatch.setattr(rivals, "fit_all", lambda problem, starts, *_, **__: [("further", v) for v in starts])
    found = rivals._carried_on(small, [{}, {}], fits, [frozenset(), frozenset()], SearchSettings())
    assert found == [("further", 0), fits[1]]


@pytest.mark.parametrize(
    ("difference", "left"),
    [
        ([3.0, 1.0, 2.0, 2.0], 4.0),  # blocks 4, 2, 2
        ([9.0, 1.0, -1.0, -2.0], 0.0),  # one block speaks for it, the others against it
        ([-9.0, -1.0, 0.5, -1.0], -0.5),
        ([-9.0, -1.0, 2.0, 0.5], 0.0),
        ([0.0, 0.0, 0.0, 0.0], 0.0),
    ],
)
def test_a_difference_counts_without_the_stretch_that_speaks_most_for_it(difference: list[float], left: float) -> None:
    assert without_the_most_telling(np.array(difference), np.array([0, 0, 1, 2])) == pytest.approx(left)


def test_one_stretch_does_not_tell_a_rival_from_the_chosen_effect() -> None:
    """Where a rival is worse in a single stretch, nothing else tells it from the chosen one."""
    lag, delay = Knob("actuator_lag", None, "time_constant"), Knob("command_delay", None, "delay")
    found = found_of({"actuator_lag": {"time_constant": 0.08}}, {lag: 0.08}, ("actuator_lag", "command_delay"))
    settings = SearchSettings()
    told = {r.came: r for r in _replacements(found.problem, found.fit, (lag.term,), found.phi, settings=settings)}
    assert told[(delay.term,)].ratio > settings.steps.alike  # every stretch tells the lag from the delay
    blocks = blocks_of(found.problem.data, settings=settings.fit)
    data = found.problem.data.take(blocks == blocks[0])
    problem = build_problem(data, found.problem.space, 1.0 / found.problem.weight, found.problem.motion)
    (fit,) = fit_all(problem, [found.fit.values])
    alone = {r.came: r for r in _replacements(problem, fit, (lag.term,), found.phi, settings=settings)}
    assert alone[(delay.term,)].ratio <= settings.rivals.per_knob


def test_a_rival_begins_beside_the_better_of_two_values_of_what_stays() -> None:
    """Without a term that explains most, the fit of the rest moves it far from where it is right."""
    gain, lag = Knob("actuator_gain", None, "gain"), Knob("actuator_lag", None, "time_constant")
    truth = {"actuator_gain": {"gain": 0.7}, "actuator_lag": {"time_constant": 0.1}}
    found = found_of(truth, {gain: 0.7, lag: 0.1}, ("actuator_gain", "actuator_lag", "wheel_radius"))
    radius = Knob("wheel_radius", None, "scale")
    (rest,) = fit_all(found.problem, [{lag: 0.4}], 0)
    (poor,) = fit_all(found.problem, [{gain: 0.7, lag: 0.4}], 0)
    (near,) = fit_all(found.problem, [{lag: found.fit.values[lag]}], 0)
    for other, chosen, taken in ((rest, found.fit, found.fit), (near, poor, near)):
        start = [{**other.values, radius: 0.7}]
        (moved,), (beside,) = _beside_the_better_values(found.problem, start, other, chosen, SearchSettings())
        assert moved == {lag: taken.values[lag], radius: 0.7} and beside.values == taken.values
    ends = _fits(found.problem, rest, found.fit, [{lag: 0.4, radius: 0.7}], found.phi, SearchSettings())
    assert ends[0].cost == pytest.approx(found.fit.cost, rel=0.02)  # on a log without encoders a radius is a gain
