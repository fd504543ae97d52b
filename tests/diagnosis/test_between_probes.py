"""Doses of thresholds between the probes: a narrow best dose is looked at, and nothing else is."""

import numpy as np
import pytest

from residual_mpc.diagnosis.search.between_probes import MOST, between_probes, threshold_of
from residual_mpc.diagnosis.search.screen import ScreenedTerm
from residual_mpc.effects.library import BY_NAME
from residual_mpc.models.settings import Knob, Term


class Bounded:
    """A space of one number, of which only the bounds and the null are asked for."""

    def __init__(self, low: float, high: float, null: float = 0.0) -> None:
        self._bounds, self._null = (low, high), null

    def bounds(self, knob: Knob) -> tuple[float, float]:
        return self._bounds

    def null(self, knob: Knob) -> float:
        return self._null


DEAD_ZONE, LIMIT = Term("dead_zone", "j2"), Term("rate_limit", "j2")
COST = 100.0  # of what is left: its norm is 10


def screened(term: Term, gains: dict[float, float], reach: float = 5.0) -> list[ScreenedTerm]:
    """One lead per dose, by what it removes of the cost and of the gap; each moves the prediction as far."""
    knob = Knob(term.effect, term.target, BY_NAME[term.effect].parameters[0].name)
    return [ScreenedTerm(term, {knob: dose}, gain, 0.0, gain, reach) for dose, gain in gains.items()]


def doses(space: Bounded, leads: list[ScreenedTerm]) -> list[float]:
    """The further doses, in order."""
    found = between_probes(space, leads, COST)  # type: ignore[arg-type]
    return sorted(value for _, values in found for value in values.values())


def test_the_neighbours_of_the_best_dose_are_looked_at() -> None:
    found = doses(Bounded(0.0, 0.9), screened(DEAD_ZONE, {0.1: 1.0, 0.2: 5.0, 0.4: -3.0}))
    assert len(found) == 2 * MOST
    assert min(found) > 0.1 and max(found) < 0.4
    ratios = np.diff(np.log([0.1, *found[:MOST], 0.2, *found[MOST:], 0.4]))
    np.testing.assert_allclose(ratios, np.log(2.0) / (MOST + 1))


def test_beyond_the_last_dose_that_is_not_felt_more_are_looked_at() -> None:
    """What a joint bears lies between the last probe and the bound: no probe says anything."""
    found = doses(Bounded(0.0, 0.45), screened(DEAD_ZONE, {0.06: 0.0, 0.1: 0.0, 0.225: 0.0}, reach=0.0))
    assert found == pytest.approx([0.225 * 2.0 ** (k / 4) for k in (1, 2, 3)])


def test_a_limit_grows_stronger_downwards() -> None:
    found = doses(Bounded(0.0, np.inf, null=np.inf), screened(LIMIT, {2.0: 0.0, 1.5: -0.1}, reach=0.2))
    assert len(found) == MOST and max(found) < 1.5 and min(found) > 0.75


def test_doses_that_are_felt_and_only_harm_need_no_others() -> None:
    assert doses(Bounded(0.0, 0.9), screened(DEAD_ZONE, {0.1: -1.0, 0.2: -5.0, 0.4: -30.0})) == []


def test_close_doses_leave_nothing_between_them() -> None:
    found = doses(Bounded(0.09, 0.11), screened(DEAD_ZONE, {0.1: 5.0}))
    assert found == []


def test_nothing_lies_beyond_a_bound() -> None:
    assert max(doses(Bounded(0.0, 0.4), screened(DEAD_ZONE, {0.2: 1.0, 0.4: 5.0}))) < 0.4


def test_probes_that_a_bound_makes_zero_are_left_alone() -> None:
    assert doses(Bounded(0.0, 0.0), screened(DEAD_ZONE, {0.0: 0.0}, reach=0.0)) == []


def test_a_part_is_looked_at_once_where_likelihood_and_gap_choose_its_two_ends() -> None:
    knob = Knob("dead_zone", "j2", "width")
    leads = [
        ScreenedTerm(DEAD_ZONE, {knob: dose}, gain, 0.0, gap, 5.0)
        for dose, gain, gap in ((0.1, -1.0, -1.0), (0.2, 5.0, 1.0), (0.4, 1.0, 5.0), (0.8, -1.0, -1.0))
    ]
    found = doses(Bounded(0.0, 1.0), leads)
    assert len(found) == 3 * MOST == len({round(dose, 6) for dose in found})


@pytest.mark.parametrize("effect", ["viscous_friction", "end_stop", "command_delay"])
def test_other_effects_have_no_threshold_between_doses(effect: str) -> None:
    term = Term(effect, "j2")
    assert threshold_of(term) is None
    assert between_probes(Bounded(0.0, 1.0), screened(term, {0.1: 5.0, 0.2: 6.0}), COST) == []  # type: ignore[arg-type]
