"""A number that says how an effect acts, and that a fit has left at a bound, begins again inside its bounds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from residual_mpc.diagnosis.fit.least_squares import fit_all
from residual_mpc.diagnosis.search.off_bounds import at_shape_bounds, off_bounds
from residual_mpc.diagnosis.search.settings import SearchSettings
from residual_mpc.models.settings import Knob, Values

STIFFNESS = Knob("joint_compliance", "j1", "stiffness")
DAMPING = Knob("joint_compliance", "j1", "damping_ratio")
BOUNDS = {STIFFNESS: (0.0, np.inf), DAMPING: (0.0, 1.0)}
TRUE = (8.0, 0.15)  # N m/rad, of critical
INERTIA, TIMES = 0.01, np.linspace(0.0, 1.0, 120)  # kg m^2, s


def swing(stiffness: float, damping: float) -> np.ndarray:
    """(n,) rad: a link let go at 1 rad, in closed form."""
    pulse = np.sqrt(max(stiffness, 1e-9) / INERTIA)
    ringing = pulse * np.sqrt(1.0 - min(damping, 0.99) ** 2)
    return np.asarray(np.exp(-damping * pulse * TIMES) * np.cos(ringing * TIMES))


@dataclass(frozen=True)
class Swing:
    """Residuals (H, 1, n) of that link."""

    measured: np.ndarray
    motion: None = None

    @property
    def space(self) -> Any:
        scales: Mapping[Knob, float] = {STIFFNESS: 1.0, DAMPING: 0.05}
        return SimpleNamespace(
            scale=scales.__getitem__,
            bounds=BOUNDS.__getitem__,
            rough=False,
            null={STIFFNESS: np.inf, DAMPING: 0.05}.get,
        )

    def residuals(self, hypotheses: Sequence[Values]) -> np.ndarray:
        return np.stack([100.0 * (swing(h[STIFFNESS], h[DAMPING]) - self.measured)[None] for h in hypotheses])


@pytest.fixture
def problem() -> Any:
    return Swing(swing(*TRUE))


def test_a_fit_that_has_lost_its_damping_begins_again_with_some(problem: Any) -> None:
    (stuck,) = fit_all(problem, [{STIFFNESS: 13.5, DAMPING: 0.0}], 0)
    assert at_shape_bounds(problem, stuck) == {DAMPING: (0.0, 1.0)}
    freed = off_bounds(problem, stuck, SearchSettings())
    assert freed.values[STIFFNESS] == pytest.approx(TRUE[0], rel=0.01)
    assert freed.values[DAMPING] == pytest.approx(TRUE[1], abs=0.01)


def test_a_fit_inside_its_bounds_is_left_alone(problem: Any) -> None:
    fit = fit_all(problem, [{STIFFNESS: 8.2, DAMPING: 0.1}])[0]
    assert not at_shape_bounds(problem, fit)
    assert off_bounds(problem, fit, SearchSettings()) is fit


def test_a_number_that_belongs_at_its_bound_stays_there() -> None:
    problem: Any = Swing(swing(TRUE[0], 0.0))
    fit = fit_all(problem, [{STIFFNESS: 8.05, DAMPING: 0.0}])[0]
    kept = off_bounds(problem, fit, SearchSettings())
    assert kept.values[STIFFNESS] == pytest.approx(TRUE[0], rel=1e-3)
    assert kept.values[DAMPING] == pytest.approx(0.0, abs=1e-3)
