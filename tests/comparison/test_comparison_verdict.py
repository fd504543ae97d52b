"""The verdict of a comparison depends on the named changes, the remaining difference and the unexplained gap."""

from __future__ import annotations

import numpy as np
import pytest

from residual_mpc.comparison.compare import _unexplained, _verdict
from residual_mpc.comparison.gaps import squared_gap_error
from residual_mpc.comparison.records import ComparedGap
from residual_mpc.comparison.settings import ComparisonSettings


@pytest.mark.parametrize(
    ("named", "p_left", "unexplained", "verdict"),
    [
        (False, 0.5, 0.0, "same"),
        (False, 0.001, 0.0, "unknown"),
        (True, 0.5, 0.1, "changed"),
        (True, 0.001, 0.1, "partial"),
        (True, 0.5, 0.5, "partial"),  # not significant, but half of the increase remains
    ],
)
def test_verdict(named: bool, p_left: float, unexplained: float, verdict: str) -> None:
    assert _verdict(named, p_left, unexplained, ComparisonSettings()) == verdict


def gap(before: float, after: float, explained: float, left_error: float = 0.0) -> ComparedGap:
    return ComparedGap(before, after, before, after, explained, left_error, 0.01, 1.0, (8, 8), 4, {})


def test_the_share_that_is_left_is_of_the_rise_of_the_squared_gap() -> None:
    assert _unexplained(gap(0.3, 0.5, 0.4)) == pytest.approx((0.16 - 0.09) / (0.25 - 0.09))
    assert _unexplained(gap(0.3, 0.5, 0.2)) == 0.0 and _unexplained(gap(0.3, 0.5, 0.9)) == 1.0
    assert _unexplained(gap(0.3, 0.2, 0.4)) == 0.0  # nothing rose


def test_what_is_left_within_the_scatter_of_the_windows_is_not_counted() -> None:
    """0.346 after 0.331 before, and 0.35 with the change: three numbers that differ by less than the runs do."""
    assert _unexplained(gap(0.331, 0.346, 0.35, left_error=0.01)) == 0.0
    assert _unexplained(gap(0.331, 0.346, 0.35, left_error=0.001)) == 1.0


def test_the_error_of_a_squared_gap_is_that_of_a_mean_of_its_units() -> None:
    rng = np.random.default_rng(0)
    each, unit = rng.chisquare(2, size=60), np.repeat(np.arange(60), 4)
    total, count = np.repeat(each, 4)[:, None], np.ones((240, 1))
    windows = np.ones(240, dtype=bool)
    error = squared_gap_error(total, count, unit, windows)
    assert error == pytest.approx(np.std(each, ddof=1) / np.sqrt(60), rel=1e-6)
    assert squared_gap_error(total, count, unit * 0, windows) == 0.0
