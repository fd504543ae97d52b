"""What a diagnosis says of the explanations that it compared, and of the experiment that tells them apart."""

from __future__ import annotations

import numpy as np
import pytest

from residual_mpc.diagnosis.fit.least_squares import Fit
from residual_mpc.diagnosis.results.alternatives import alternatives, candidates, rival_sets
from residual_mpc.diagnosis.results.next_experiment import EXPLORE, next_experiment
from residual_mpc.diagnosis.results.settings import ResultSettings
from residual_mpc.diagnosis.search.rivals import Rival, Rivalry
from residual_mpc.effects.equivalents import ENCODERS, SEPARATIONS
from residual_mpc.effects.library import BY_NAME
from residual_mpc.models.settings import Knob, Term, Values

RADIUS, GAIN, TRACK = Term("wheel_radius", None), Term("actuator_gain", None), Term("track_width", None)
SLIP, DELAY, BIAS = Term("lateral_slip", None), Term("command_delay", None), Term("sensor_bias", None)
EMPTY = np.zeros(0)


def fit(cost: float, *terms: Term) -> Fit:
    """Of which only the terms, a value each, and the cost are looked at."""
    values: Values = {Knob(t.effect, t.target, BY_NAME[t.effect].parameters[0].name): cost for t in terms}
    return Fit(terms, tuple(values), values, EMPTY, cost, EMPTY, EMPTY, EMPTY.astype(bool))


def rival(gone: Term, came: Term, ratio: float, cost: float = 30.0, alike: bool = False) -> Rival:
    return Rival((gone,), (came,), fit(cost, came, TRACK), ratio, alike)


FINAL = fit(25.0, RADIUS, TRACK)
RIVALRY = Rivalry(
    FINAL,
    (rival(RADIUS, GAIN, 0.0, 25.0, alike=True), rival(RADIUS, SLIP, 2.0 * np.log(4.0), 36.0)),
    (((RADIUS,), (GAIN,)),),
    {RADIUS: 0.4, GAIN: 0.4, SLIP: 0.2, TRACK: 1.0},
    FINAL,
)


def test_sets_share_the_likelihood() -> None:
    """A ratio is twice the difference in log-likelihood: at 2 log 4 a set holds a quarter of what the best one does."""
    found = {s.effects: s.probability for s in rival_sets(RIVALRY)}
    assert found == pytest.approx({(RADIUS, TRACK): 4 / 9, (GAIN, TRACK): 4 / 9, (SLIP, TRACK): 1 / 9})


def test_sets_that_differ_in_two_places_are_there_as_well() -> None:
    """Two groups of two are four sets, so that each member's share is that of its group."""
    two = (rival(RADIUS, GAIN, 0.0, 25.0, alike=True), Rival((TRACK,), (BIAS,), fit(25.0, RADIUS, BIAS), 0.0, True))
    found = {frozenset(s.effects): s.probability for s in rival_sets(Rivalry(FINAL, two, (), {}, FINAL))}
    every = [frozenset({a, b}) for a in (RADIUS, GAIN) for b in (TRACK, BIAS)]
    assert found == pytest.approx(dict.fromkeys(every, 0.25))


def test_what_is_left_out_is_in_no_set_nor_what_stood_in_its_place() -> None:
    """Also where the search had found another member of its group."""
    found = {s.effects: s.probability for s in rival_sets(RIVALRY, (RADIUS,))}
    assert found == pytest.approx({(TRACK,): 1.0})
    exchanged = Rivalry(FINAL, (rival(GAIN, RADIUS, 0.0, 25.0, alike=True),), (), {}, fit(25.0, GAIN, TRACK))
    assert [s.effects for s in rival_sets(exchanged, (RADIUS,))] == [(TRACK,)]


def test_a_rival_of_what_is_left_out_is_no_surer_than_it() -> None:
    sure = {TRACK: 0.9, RADIUS: 0.2}  # the probability of the place
    found = {c.term: c.probability for c in candidates(RIVALRY, fit(100.0), fit(26.0, TRACK), sure, (), {})}
    assert found == pytest.approx({RADIUS: 0.08, GAIN: 0.08, SLIP: 0.04, TRACK: 0.9})


SURE = {RADIUS: 0.9, TRACK: 0.9}


def test_a_rival_is_as_sure_as_what_it_would_replace() -> None:
    found = {c.term: c.probability for c in candidates(RIVALRY, fit(100.0), FINAL, {RADIUS: 0.5, TRACK: 0.9}, (), {})}
    assert found == pytest.approx({RADIUS: 0.2, GAIN: 0.2, SLIP: 0.1, TRACK: 0.9})


def test_a_candidate_has_its_share_of_what_any_cause_gets_and_the_shrink_of_its_set() -> None:
    """The gap is the root of the cost: from 100 to 25 it halves, to 36 it loses 0.4."""
    found = {c.term: c for c in candidates(RIVALRY, fit(100.0), FINAL, SURE, (), {TRACK: 0.5})}
    probabilities = {RADIUS: 0.36, GAIN: 0.36, SLIP: 0.18, TRACK: 0.45}
    assert {t: c.probability for t, c in found.items()} == pytest.approx(probabilities)
    assert {t: c.shrink for t, c in found.items()} == pytest.approx({RADIUS: 0.5, TRACK: 0.5, GAIN: 0.5, SLIP: 0.4})
    ranked = [c.probability for c in candidates(RIVALRY, fit(100.0), FINAL, SURE, (), {})]
    assert ranked == sorted(ranked, reverse=True)


def test_what_a_later_look_refuted_is_not_probable() -> None:
    found = {c.term: c.probability for c in candidates(RIVALRY, fit(100.0), FINAL, SURE, (SLIP,), {})}
    assert found[SLIP] == 0.0 and found[GAIN] == pytest.approx(0.36)


def test_alternatives_are_the_other_members_of_a_group_and_the_closest_rivals() -> None:
    group, close = alternatives(RIVALRY, RIVALRY.groups, FINAL, settings=ResultSettings())
    assert (group.terms, group.instead_of, group.confounded) == ((GAIN,), (RADIUS,), True)
    assert group.values == RIVALRY.rivals[0].fit.values
    assert (close.terms, close.instead_of, close.confounded) == ((SLIP,), (RADIUS,), False)
    assert close.ratio == RIVALRY.rivals[1].ratio


def test_an_alternative_stands_beside_the_named_members_of_the_other_groups() -> None:
    """The search found readings that are late, of which the delay of commands is the named twin, and a gain."""
    late = Term("sensor_delay", None)
    as_found, named = fit(25.0, late, GAIN), fit(26.0, DELAY, GAIN)
    rivals = (
        Rival((late,), (DELAY,), named, 0.0, True),
        Rival((GAIN,), (RADIUS,), fit(24.0, late, RADIUS), 0.0, True),
        Rival((GAIN,), (SLIP,), fit(27.0, late, SLIP), 2.0, False),
    )
    groups = (((DELAY,), (late,)), ((GAIN,), (RADIUS,)))
    found = alternatives(Rivalry(named, rivals, groups, {}, as_found), groups, named, settings=ResultSettings())
    sets = {a.terms: {k.term: v for k, v in a.values.items()} for a in found}
    assert sets == {
        (late,): {late: 25.0, GAIN: 25.0},
        (RADIUS,): {DELAY: 26.0, RADIUS: 24.0},
        (SLIP,): {DELAY: 26.0, SLIP: 27.0},
    }


def test_rivals_that_are_beyond_doubt_worse_and_all_but_the_closest_are_no_alternatives() -> None:
    others = [Term("command_delay", t) for t in ("a", "b", "c", "d")]
    ratios = (3.0, 1.0, 4.0, 2.0)
    many = tuple(rival(RADIUS, t, r) for t, r in zip(others, ratios, strict=True))
    rivalry = Rivalry(FINAL, (*many, rival(RADIUS, BIAS, 60.0)), (), {}, FINAL)
    found = alternatives(rivalry, (), FINAL, settings=ResultSettings())
    assert len(found) == ResultSettings().closest and [a.ratio for a in found] == [1.0, 2.0, 3.0]
    alone = Rivalry(FINAL, (rival(RADIUS, BIAS, 60.0),), (), {}, FINAL)
    assert alternatives(alone, (), FINAL, settings=ResultSettings()) == ()


@pytest.mark.parametrize("wheeled", [True, False])
def test_each_pair_of_the_table_has_its_experiment(wheeled: bool) -> None:
    for separation in SEPARATIONS:
        pair, what = separation.pair, separation.wheeled if wheeled else separation.arm
        if not what:
            continue
        group = tuple((Term(name, None),) for name in sorted(pair))
        said = next_experiment([group], wheeled, "effects")
        assert said is not None and set(said["parts"]) == pair and said["what"] == what  # type: ignore[call-overload]
        assert all(name in BY_NAME for name in pair)


def test_a_group_comes_before_a_gap_that_is_left_and_one_that_no_row_knows_has_an_experiment_too() -> None:
    known = ((RADIUS,), (GAIN,))
    assert next_experiment([known], True, "partial") == {
        "parts": ["actuator_gain", "wheel_radius"],
        "what": ENCODERS,
        "commands": None,
    }
    unknown = next_experiment([((BIAS,), (SLIP,))], True, "effects")
    assert unknown is not None and unknown["parts"] == ["lateral_slip", "sensor_bias"] and unknown["what"]


def test_without_a_group_only_a_gap_that_is_left_asks_for_an_experiment() -> None:
    for verdict in ("unknown", "partial"):
        said = next_experiment([], True, verdict)  # type: ignore[arg-type]
        assert said == {"parts": [], "what": EXPLORE, "commands": None}
    assert next_experiment([], True, "effects") is None and next_experiment([], True, "no_gap") is None
