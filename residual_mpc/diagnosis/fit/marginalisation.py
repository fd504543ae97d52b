"""A problem with the small differences of the robot at hand marginalised, at the level that a fit leaves likely."""

from dataclasses import replace

import numpy as np

from residual_mpc.diagnosis.fit.evidence import blocks_of
from residual_mpc.diagnosis.fit.least_squares import Fit
from residual_mpc.diagnosis.fit.settings import FitSettings
from residual_mpc.diagnosis.predict.prediction_cache import Carried, PredictionCache
from residual_mpc.diagnosis.predict.problem import Problem, tolerating, whitened
from residual_mpc.diagnosis.predict.step_error import finer_prediction
from residual_mpc.diagnosis.predict.tolerances import Tolerances, likeliest_level, small_differences
from residual_mpc.models.settings import Knob, Values


def tolerant(problem: Problem, fit: Fit, settings: FitSettings, share: float = 1.0) -> Problem:
    """The problem with its tolerances at the level that this fit's residuals make likeliest; share: of all windows that
    the problem holds."""
    plain = tolerating(problem, None)
    if problem.tolerances is None or not problem.tolerances.columns.shape[2]:
        return plain
    blocks = blocks_of(problem.data, settings=settings)
    a, r = whitened(plain, problem.tolerances.columns), plain.residuals([fit.values])[0]
    gram, score = a.T @ a, a.T @ r.ravel()
    inverse = np.linalg.pinv(gram, rcond=1e-9, hermitian=True)
    left = r - (a @ (inverse @ score)).reshape(r.shape)
    scores = np.zeros((blocks.max() + 1, a.shape[1]))
    np.add.at(scores, blocks, np.einsum("wnk,wn->wk", a.reshape(*r.shape, -1), left))
    phi = max(1.0, float(np.einsum("kl,bk,bl->", inverse, scores, scores)) / a.shape[1])
    level = likeliest_level(gram, score, phi, settings=settings.predict, share=share)
    return tolerating(plain, replace(problem.tolerances, level=level, dispersion=phi))


def carrying(
    problem: Problem,
    values: Values,
    free: tuple[Knob, ...] = (),
    by: PredictionCache | None = None,
    *,
    settings: FitSettings,
) -> Problem:
    """The problem with the columns of its tolerances measured at these values, not yet marginalised; none of `free`. It
    has none at all where the settings marginalise nothing.

    by: predictions on the same windows that differ from the problem's in their steps alone, None for the problem's.
    What the model's own time step lacks is one of them: it is a small difference like the others. Columns that were
    measured at nearly the same values before are taken over: they hardly change."""
    if not settings.predict.tolerances.marginalised:
        return tolerating(problem, None)
    known = problem.replays.carried
    reusable = by is None and not free
    if reusable and known and known[-1].near(problem.space, values, settings.predict.tolerances.near):
        return tolerating(problem, Tolerances(known[-1].columns, 0.0))
    rows = small_differences(problem.space, values, free, settings=settings.predict)
    here, *moved = (by or problem.replays)([values, *(d.values for d in rows)])
    seen = np.isfinite(problem.data.y)
    own, row = problem.replays.own, problem.space.settings([values])
    exact = own is None and by is None
    finer = finer_prediction(problem.data if own is None else own, row, here if exact else None)
    changes = [m - here for m in moved] + ([] if finer is None else [finer])
    columns = [np.clip(np.nan_to_num(np.where(seen, m, 0.0)), -1e6, 1e6).reshape(len(here), -1) for m in changes]
    stacked = np.stack(columns, axis=-1) if columns else np.zeros((len(here), here[0].size, 0))
    if reusable:
        known[:] = [Carried(values, problem.space.candidates, stacked)]
    return tolerating(problem, Tolerances(stacked, 0.0))
