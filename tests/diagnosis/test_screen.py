"""Thinning keeps what is rare: windows stand for as many as they were drawn from."""

import numpy as np
import pytest

from residual_mpc.diagnosis.search.additions import varied
from residual_mpc.diagnosis.search.screen import ScreenedTerm, _best_of_terms, drawn
from residual_mpc.diagnosis.search.settings import SearchSettings
from residual_mpc.models.settings import Term


def test_the_windows_drawn_stand_for_all() -> None:
    cost = np.random.default_rng(0).gamma(2.0, size=400)
    counts = drawn(cost, 60)
    assert 30 <= np.count_nonzero(counts) <= 60
    assert counts.sum() == pytest.approx(400, rel=0.1)
    assert counts @ cost == pytest.approx(cost.sum(), rel=0.1)


def test_a_window_that_holds_nearly_everything_is_always_drawn() -> None:
    for place in range(50):
        cost = np.ones(50)
        cost[place] = 1e4
        counts = drawn(cost, 12)
        assert counts[place] > 0.0
        assert counts @ cost == pytest.approx(cost.sum(), rel=0.2)


def test_nothing_left_to_explain_is_drawn_evenly() -> None:
    counts = drawn(np.zeros(40), 10)
    assert np.count_nonzero(counts) == 10
    np.testing.assert_allclose(counts[counts > 0], 4.0)


def test_a_glance_draws_the_few_windows_that_hold_half_of_what_is_left() -> None:
    """A limit that one window in thirty reaches; by the roots of the costs it would now and then be lost."""
    lost = 0
    for place in range(60):
        cost = np.random.default_rng(place).gamma(2.0, size=60)
        cost[[place, (place + 30) % 60]] = 0.25 * cost.sum()
        there = [place, (place + 30) % 60]
        assert (drawn(cost, 14, power=1.0)[there] == 1.0).all()
        lost += not (drawn(cost, 14)[there] > 0.0).all()
    assert lost > 0


def test_many_doses_of_one_effect_leave_room_for_the_next() -> None:
    weak, limit = Term("actuator_gain", None), Term("saturation", None)
    leads = [ScreenedTerm(weak, {}, 10.0 - k, 0.0, 0.0, 1.0) for k in range(5)] + [
        ScreenedTerm(limit, {}, 1.0, 0.0, 0.0, 1.0)
    ]
    assert varied(leads, settings=SearchSettings()) == [*leads[: SearchSettings().additions.probes], leads[5]]


def test_of_the_further_doses_of_a_threshold_the_best_ones_are_kept() -> None:
    zone, limit = Term("dead_zone", "j2"), Term("rate_limit", "j2")
    leads = [ScreenedTerm(zone, {}, gain, 0.0, gap, 1.0) for gain, gap in ((1.0, 9.0), (5.0, 2.0), (4.0, 3.0))]
    other = ScreenedTerm(limit, {}, 0.5, 0.0, 0.5, 1.0)
    kept = _best_of_terms([*leads, other])
    assert {id(lead) for lead in kept} == {id(leads[0]), id(leads[1]), id(other)}
