"""The verdict of a comparison depends on the named changes, the remaining difference and the unexplained gap."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from residual_mpc.comparison.compare import _unexplained, _verdict
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
    found: Any = SimpleNamespace(changes=("a change",) if named else ())
    assert _verdict(found, p_left, unexplained, ComparisonSettings()) == verdict


def test_the_share_that_is_left_is_of_the_rise_of_the_squared_gap() -> None:
    assert _unexplained(0.3, 0.5, 0.4) == pytest.approx((0.16 - 0.09) / (0.25 - 0.09))
    assert _unexplained(0.3, 0.5, 0.2) == 0.0 and _unexplained(0.3, 0.5, 0.9) == 1.0
    assert _unexplained(0.3, 0.2, 0.4) == 0.0  # nothing rose
