"""What a reader is told before trusting the figures."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from residual_mpc.diagnosis.results.conditions import notes
from residual_mpc.diagnosis.results.settings import ResultSettings


def a_look(horizon: float, before: float, after: float) -> Any:
    gaps = {name: SimpleNamespace(total=x) for name, x in (("before", before), ("after", after), ("steady", after))}
    floor = SimpleNamespace(total=0.005)
    return SimpleNamespace(horizon=horizon, nominal=gaps["before"], floor=floor, unjudged=0, decides=True, **gaps)


@pytest.mark.parametrize(
    ("longer", "said"),
    [
        (a_look(15.0, 0.0085, 0.0177), True),
        (a_look(15.0, 0.005, 0.0095), False),  # within the noise
        (a_look(15.0, 0.03, 0.02), False),
    ],
)
def test_effects_that_make_a_longer_gap_larger_are_remarked(longer: Any, said: bool) -> None:
    first = a_look(1.0, 0.028, 0.021)
    found: Any = SimpleNamespace(
        looks=(first, longer), helps=True, useless=False, stepping=False, step_error=None, constant_velocity=1.0,
        left=first.after,
    )  # fmt: skip
    of: Any = SimpleNamespace(
        doubtful=(), vetoed=(), in_parts={}, unlikely={}, run_sizes={}, untestable=(), held=np.ones(1, dtype=bool),
        raw=SimpleNamespace(skipped=0, runs=()),
        with_outliers=False,
        outliers=SimpleNamespace(count=0), final=SimpleNamespace(knobs=(), held=(), terms=(), values={}),
    )  # fmt: skip
    *remarks, _ = notes(of, found, None, None, ResultSettings())
    assert len(remarks) == said
    if said:
        assert remarks[0].startswith("Over 15 s the named effects make the gap larger, 0.018 instead of 0.0085 (noise")
