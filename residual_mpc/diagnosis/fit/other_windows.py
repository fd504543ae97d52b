"""Whether windows of another length tell other numbers.

With the right model, windows of any length have the same numbers in expectation, some more precisely than others. An
error of the model that grows or fades within a window, such as a wheel whose loop catches up late, moves them
systematically.
"""

import numpy as np

from residual_mpc.diagnosis.fit.evidence import T95, blocks_of, covariance
from residual_mpc.diagnosis.fit.least_squares import Fit, fit_all
from residual_mpc.diagnosis.fit.settings import FitSettings
from residual_mpc.diagnosis.predict.problem import Problem
from residual_mpc.models.settings import Values

STEPS = 4  # of the fit to the other windows, from where the numbers are
LEAST = 0.5  # of a number's standard deviation, that of the difference at least


def apart_on(problem: Problem, final: Fit, other: Problem, settings: FitSettings) -> Values:
    """The numbers fitted to other windows that differ from those of a fit by more than chance explains.

    The variance of the difference of two estimates from the same data, of which one is efficient, is that of their
    variances (Hausman, Specification Tests in Econometrics, 1978, eq. 2.13); neither is here, so that it is taken
    without its sign.
    """
    there = fit_all(other, [final.values], STEPS, settings=settings)[0]
    here, away = (
        np.diag(covariance(fit, blocks_of(of.data, settings=settings)))
        for of, fit in ((problem, final), (other, there))
    )
    sigma = np.sqrt(np.maximum(np.abs(away - here), LEAST**2 * here))
    shift = np.array([there.values[k] - final.values[k] for k in final.knobs])
    apart = (np.abs(shift) > T95 * sigma) & ~there.held & ~final.held & (sigma > 0.0)
    return {k: there.values[k] for k, yes in zip(final.knobs, apart.tolist(), strict=True) if yes}
