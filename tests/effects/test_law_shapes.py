"""Fitted laws as functions: what their numbers mean, in every array library, and nothing at null."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from residual_mpc.effects.laws import (
    KINDS,
    LAWS,
    curve,
    curve_shape,
    is_law,
    points_of,
    published,
    quantities_of,
    rounded,
    wave,
)
from residual_mpc.effects.library import BY_NAME, HOSTED, LIBRARY
from residual_mpc.effects.ops import NUMPY, casadi_ops
from residual_mpc.export.soften import kinks
from residual_mpc.models.settings import is_null

Z = np.linspace(-3.0, 4.0, 57)
KNOTS, VALUES = [-1.0, 0.5, 2.0], [0.3, -0.2, 0.7]
BENT = {**curve_shape(KNOTS), "start": 0.3, "rise2": -0.5, "rise3": 0.9}
WAVE = {"cycles": 7.0, "offset": 0.1, "cos": 0.4, "sin": -0.3}


def test_a_curve_goes_through_its_knots_and_holds_its_ends() -> None:
    np.testing.assert_allclose(curve(NUMPY, BENT, Z), np.interp(Z, KNOTS, VALUES), atol=1e-15)


def test_a_wave_is_the_textbooks() -> None:
    amplitude, phase = np.hypot(0.4, -0.3), np.arctan2(0.4, -0.3)
    np.testing.assert_allclose(wave(NUMPY, WAVE, Z), 0.1 + amplitude * np.sin(7.0 * Z + phase), atol=1e-14)


@pytest.mark.parametrize(("law", "p"), [(curve, BENT), (wave, WAVE)])
def test_casadi_gives_the_same_numbers(law, p) -> None:
    z = ca.SX.sym("z")
    f = ca.Function("f", [z], [law(casadi_ops(), p, z)])
    np.testing.assert_allclose(np.array(f(Z)).ravel(), law(NUMPY, p, Z), atol=1e-14)


def test_rounded_corners_have_a_slope_everywhere_and_stay_near() -> None:
    z = ca.SX.sym("z")
    f = curve(rounded(kinks(casadi_ops(), 0.01)), BENT, z)
    slope = ca.Function("g", [z], [ca.gradient(f, z)])
    fine = np.linspace(-1.2, 2.2, 3401)
    steps = np.abs(np.diff(np.array(slope(fine)).ravel()))
    assert steps.max() < 0.02  # the exact one jumps by 0.9 at a corner
    assert np.abs(np.array(ca.Function("f", [z], [f])(fine)).ravel() - np.interp(fine, KNOTS, VALUES)).max() < 0.05


@pytest.mark.parametrize("law", LAWS, ids=lambda e: e.name)
def test_a_law_at_null_adds_nothing(law) -> None:
    null = {p.name: np.full((1, 1), p.null) for p in law.parameters}
    assert is_null(law.name, null).all()
    if law.port == "law":
        signals = [Z] * len(quantities_of(law))
        np.testing.assert_array_equal(law.step(NUMPY, null, *signals), np.zeros_like(Z)[None])
    else:
        np.testing.assert_array_equal(law.step(NUMPY, null, (), Z, 3.0, 0.01)[0], Z[None])


@pytest.mark.parametrize("kind", KINDS, ids=lambda k: k.name)
def test_points_are_the_law(kind) -> None:
    p = WAVE if kind.shape == "wave" else BENT
    knots, values = points_of(kind, p)
    np.testing.assert_allclose(values, (wave if kind.shape == "wave" else curve)(NUMPY, p, knots), atol=1e-14)


def test_laws_are_hosted_and_never_searched_for() -> None:
    names = {e.name for e in LAWS}
    assert not names & {e.name for e in LIBRARY} and names <= {e.name for e in HOSTED}
    assert all(is_law(e.name) and published(e.name) == "fitted_law" and BY_NAME[e.name] is e for e in LAWS)
    assert not any(is_law(e.name) or published(e.name) != e.name for e in LIBRARY)
