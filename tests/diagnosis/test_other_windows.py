"""Numbers that windows of another length contradict."""

from __future__ import annotations

import numpy as np
import pytest
from diagnosis.linear import GAIN, SCALE, Linear, fitted, space_of, windows

from residual_mpc.diagnosis.fit.other_windows import apart_on
from residual_mpc.diagnosis.fit.settings import FitSettings

SAMPLES, TRUTH = 20, {SCALE: 1.2, GAIN: 0.9}


def cut(seconds: float, rng: np.random.Generator, bias: float = 0.0) -> Linear:
    """The same runs in windows of which a model error makes the scale seem larger by `bias`."""
    data = windows(6, seconds)
    columns = dict(zip((SCALE, GAIN), 3.0 * rng.standard_normal((2, data.count, SAMPLES)), strict=True))
    noise = rng.standard_normal((data.count, SAMPLES)) - bias * columns[SCALE]
    return Linear(data, space_of(data), columns, TRUTH, noise)


@pytest.mark.parametrize("seed", range(5))
def test_the_right_model_has_the_same_numbers_in_all_windows(seed: int) -> None:
    rng = np.random.default_rng(seed)
    here, other = cut(30.0, rng), cut(20.0, rng)
    fit = fitted(here, {SCALE: 1.0, GAIN: 1.0})
    apart = apart_on(here, fit, other, FitSettings())  # type: ignore[arg-type]
    assert all(abs(value - TRUTH[knob]) < 0.05 for knob, value in apart.items())


def test_what_a_model_error_moves_in_other_windows_is_told() -> None:
    rng = np.random.default_rng(0)
    here, other = cut(30.0, rng), cut(20.0, rng, 0.2)
    fit = fitted(here, {SCALE: 1.0, GAIN: 1.0})
    apart = apart_on(here, fit, other, FitSettings())  # type: ignore[arg-type]
    assert set(apart) == {SCALE} and apart[SCALE] == pytest.approx(1.4, abs=0.05)
