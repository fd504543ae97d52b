"""The intervals of the baselines: those of ordinary least squares, which takes every residual as white."""

from __future__ import annotations

import numpy as np
from diagnosis.linear import GAIN, SCALE, Linear, fitted, space_of, white, windows

from residual_mpc.blind.baselines.problem import standard_errors


def test_a_standard_error_is_that_of_the_textbook() -> None:
    data, rng = windows(2, 30.0), np.random.default_rng(0)
    columns = dict(zip((SCALE, GAIN), rng.standard_normal((2, data.count, 30)), strict=True))
    problem = Linear(data, space_of(data), columns, {SCALE: 1.2, GAIN: 0.9}, white(data, rng))
    fit = fitted(problem, {SCALE: 1.0, GAIN: 1.0})
    j = np.stack([columns[SCALE].ravel(), columns[GAIN].ravel()], axis=1)
    freedom = j.shape[0] - 2
    exact = np.sqrt(np.diag(np.linalg.inv(j.T @ j)) * fit.cost / freedom)
    np.testing.assert_allclose(standard_errors(fit), exact, rtol=1e-3)
