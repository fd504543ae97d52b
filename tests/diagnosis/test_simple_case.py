"""A friction whose levels are equal within their intervals is one that does not depend on the speed."""

from __future__ import annotations

import numpy as np
import pytest

from residual_mpc.diagnosis.fit.least_squares import Fit
from residual_mpc.diagnosis.search.close_rivals import Rival, is_its_simple_case
from residual_mpc.diagnosis.search.settings import SearchSettings
from residual_mpc.models.settings import Knob, Term

STRIBECK, COULOMB = Term("stribeck_friction", "j1"), Term("coulomb_friction", "j1")
WINDOWS, SAMPLES = 60, 20


def fitted(static: float, kinetic: float, sigma: float) -> Fit:
    """A fit under white residuals whose numbers have this standard deviation."""
    rng = np.random.default_rng(0)
    values = {
        Knob(STRIBECK.effect, STRIBECK.target, p): v
        for p, v in (("static", static), ("kinetic", kinetic), ("velocity", 0.1))
    }
    j = rng.standard_normal((WINDOWS, SAMPLES, len(values)))
    r = rng.standard_normal((WINDOWS, SAMPLES))
    scales = np.full(len(values), sigma * np.sqrt(WINDOWS * SAMPLES))
    held = np.zeros(len(values), dtype=bool)
    return Fit((STRIBECK,), tuple(values), values, scales, float(np.sum(r * r)), r, j, held)


def simple(fit: Fit, came: Term = COULOMB) -> bool:
    rival = Rival((STRIBECK,), (came,), fit, 30.0, False)
    return is_its_simple_case(fit, rival, np.arange(WINDOWS), SearchSettings())


@pytest.mark.parametrize(
    ("static", "kinetic", "sigma", "wanted"),
    [
        (0.51, 0.49, 1e-4, True),  # no law is exact to 3 %
        (0.51, 0.44, 1e-4, False),
        (0.51, 0.44, 0.03, True),
        (0.9, 0.4, 0.03, False),
    ],
)
def test_levels_that_the_runs_do_not_tell_apart(static: float, kinetic: float, sigma: float, wanted: bool) -> None:
    assert simple(fitted(static, kinetic, sigma)) is wanted


def test_another_joint_or_another_effect_is_no_simple_case() -> None:
    same = fitted(0.5, 0.5, 0.01)
    assert simple(same)
    assert not simple(same, Term("coulomb_friction", "j2"))
    assert not simple(same, Term("viscous_friction", "j1"))
