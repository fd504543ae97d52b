"""Channels weighed by what a model leaves of them."""

from dataclasses import replace

import numpy as np

from residual_mpc.diagnosis.data.gap import Scales, fit_trust
from residual_mpc.diagnosis.data.settings import DataSettings
from residual_mpc.diagnosis.predict.problem import Problem, reweigh
from residual_mpc.models.settings import Values


def weighed_by_residuals(problem: Problem, scales: Scales, values: Values, settings: DataSettings) -> Problem:
    """The problem with each channel scaled by the residual that these values leave, or by its noise if that is larger;
    outlying windows are down-weighted. scales: of the problem's motion."""
    data = problem.data
    trust = fit_trust(data, scales, data.y - problem.replays([values])[0], settings=settings)
    trusting = problem if (trust == 1.0).all() else replace(problem, count=trust)
    r = trusting.residuals([values])[0].reshape(*data.y.shape)
    seen = np.einsum("w,wmc->c", trust, np.isfinite(data.y).astype(float))
    left = np.sqrt(np.einsum("wmc,wmc->c", r, r) / np.maximum(seen, 1.0))
    return replace(reweigh(problem, data.sigma * np.maximum(left, 1.0)), count=trusting.count)
