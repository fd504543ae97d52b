"""A change is told with the gap of its own windows, as measured and as the reference has it for such motions."""

from __future__ import annotations

import numpy as np
import pytest

from residual_mpc.monitoring.events import Moment
from residual_mpc.monitoring.places import Place, gaps_of
from residual_mpc.report.watch import event_lines

AT = Moment("run", 0.0, 0.0)


def place(error: float, usual: float) -> Place:
    """A window whose squared error is this, where the reference has another for such a motion."""
    two = np.array([error, error])
    return Place(0, AT, two, np.log(two / usual), np.zeros(2), False)


def test_larger_motions_do_not_turn_a_smaller_error_into_a_larger_one() -> None:
    now, usual = gaps_of([place(0.04, 0.09), place(0.16, 0.36)], 0, np.zeros(3))
    assert (now, usual) == pytest.approx((np.sqrt(0.1), np.sqrt(0.225)))


def test_windows_that_the_reference_does_not_know_do_not_count() -> None:
    strange = Place(0, AT, np.full(2, 9.0), np.full(2, np.nan), np.full(2, np.nan), True)
    assert gaps_of([place(0.04, 0.01), strange], 1, np.zeros(3)) == pytest.approx((0.2, 0.1))


def test_a_scattering_reference_has_a_larger_mean_than_its_logarithm_says() -> None:
    rest = np.random.default_rng(0).normal(0.0, 0.8, 20_000)
    error = 0.04 * np.exp(rest)
    drawn = [Place(0, AT, np.full(2, e), np.full(2, x), np.zeros(2), False) for e, x in zip(error, rest, strict=True)]
    now, usual = gaps_of(drawn, 0, np.random.default_rng(1).normal(0.0, 0.8, 20_000))
    assert usual == pytest.approx(now, rel=0.03)


@pytest.mark.parametrize(("unlike", "certain"), [(0.1, True), (0.24, True), (0.26, False), (0.9, False)])
def test_an_alarm_says_where_the_driving_differs(unlike: float, certain: bool) -> None:
    at = {"run": "run", "t": 9.0, "clock": 9.0}
    event = {"event": "change", "at": at, "since": at, "what": "pose.x", "grew": True, "gap": 0.2, "reference": 0.1,
             "windows": 30, "unlike": unlike}  # fmt: skip
    (line,) = event_lines(event)
    assert ("for certain" in line) == certain
    assert ("driven differently" in line and f"{100 * unlike:.0f}" in line) == (not certain)
