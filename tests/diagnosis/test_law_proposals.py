"""The shape of a law, chosen where it was not fitted: the simplest that does as well."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from residual_mpc.diagnosis.laws.settings import LawSettings
from residual_mpc.diagnosis.laws.shapes import Shape, best_shape
from residual_mpc.diagnosis.remainder.missing_rates import MissingRate
from residual_mpc.effects.laws import KINDS, LawKind

W, INSTANTS, SAMPLES, DT = 80, 6, 40, 0.02
CURVE = next(k for k in KINDS if (k.of, k.on, k.shape) == ("torque", "position", "curve"))
WAVE = next(k for k in KINDS if k.shape == "wave")


def seen(law: Callable[[np.ndarray], np.ndarray], noise: float = 0.002) -> tuple[MissingRate, np.ndarray]:
    """What a missing rate that is a law of z leaves: its integral at a few instants; z (W, M)."""
    rng = np.random.default_rng(0)
    z = 2.0 * np.sin(rng.uniform(0.3, 2.0, (W, 1)) * DT * np.arange(SAMPLES) * 4 + rng.uniform(0, 6.28, (W, 1)))
    at = np.linspace(5, SAMPLES - 1, INSTANTS).astype(int)
    integral = DT * (np.arange(SAMPLES)[None, :] < at[:, None])
    response = np.broadcast_to(integral, (W, INSTANTS, SAMPLES))
    error = np.einsum("im,wm->wi", integral, law(z)) + noise * rng.standard_normal((W, INSTANTS))
    return MissingRate("position.j", "rad/s^2", error, noise**2, response, np.ones(W, dtype=bool)), z


def chosen(law: Callable[[np.ndarray], np.ndarray], kind: LawKind = CURVE) -> Shape | None:
    m, z = seen(law)
    turns = tuple(range(2, 20))
    return best_shape(kind, m, z, np.ones_like(z), np.arange(W) // 4 % 5, turns, LawSettings())


@pytest.mark.parametrize(
    ("form", "law"),
    [
        ("constant", lambda z: 0.3 + 0.0 * z),
        ("line", lambda z: 0.2 - 0.4 * z),
        ("bend", lambda z: -0.5 * np.maximum(z, 0.0)),
        ("step", lambda z: np.where(z > 0.0, 0.4, -0.1)),
        ("saturating", lambda z: np.clip(z, -0.6, 0.6)),
        ("curve", lambda z: 0.5 * np.sin(4.0 * z)),
    ],
)
def test_each_form_is_taken_for_itself(form: str, law: Callable[[np.ndarray], np.ndarray]) -> None:
    shape = chosen(law)
    assert shape is not None and shape.form == form
    if form in ("bend", "step"):
        middle = shape.fixed["knot2"] if form == "bend" else 0.5 * (shape.fixed["knot1"] + shape.fixed["knot2"])
        assert abs(middle) < 0.15


def test_a_wave_has_the_right_number_of_repetitions() -> None:
    shape = chosen(lambda z: 0.4 * np.sin(11.0 * z + 0.7), WAVE)
    assert shape is not None and shape.fixed["cycles"] == 11.0
