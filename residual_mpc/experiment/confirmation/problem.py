"""The new runs as a fitting problem: windows, hypotheses, and the weights of channels and windows."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from residual_mpc.diagnosis.data.dataset import joined
from residual_mpc.diagnosis.data.gap import Scales, fit_trust
from residual_mpc.diagnosis.data.subsampling import thin_whole
from residual_mpc.diagnosis.fit.least_squares import Fit, fit_all, on_problem
from residual_mpc.diagnosis.phases.prepare import Prepared
from residual_mpc.diagnosis.predict.longer_steps import on_longer_steps
from residual_mpc.diagnosis.predict.problem import Problem, build_problem, reweigh
from residual_mpc.diagnosis.predict.space import Space
from residual_mpc.effects.library import BY_NAME
from residual_mpc.experiment.confirmation.settings import ConfirmationSettings
from residual_mpc.models.settings import TUNE, Knob, Values


@dataclass(frozen=True, eq=False)
class FittedExplanations:
    """fits: one of each explanation to the new runs, in the same order."""

    problem: Problem
    fits: tuple[Fit, ...]


def fit_explanations(
    prepared: Prepared, explanations: Sequence[Values], settings: ConfirmationSettings
) -> FittedExplanations:
    """Fit each explanation to the new runs, from its own values. Each channel is scaled by the residual of the best
    fit, or by its noise if that is larger."""
    results = settings.results
    space = holding_shapes(prepared.space, explanations)
    starts = [{k: v for k, v in values.items() if k not in space.fixed} for values in explanations]
    windows = [prepared.headline, *(look.free for look in prepared.longer if look.free is not None)]
    data = thin_whole(joined([d for d, _ in windows]), settings.steps, settings=results.data)
    scales = windows[-1][1]
    exact = build_problem(data, space, data.sigma, scales.motion, settings=results.predict)
    problem = on_longer_steps(exact, scales, starts[0], settings=results.predict)
    first = fit_all(problem, starts, settings.fit_steps, settings=results.fit)
    problem = _weighed(problem, scales, min(first, key=lambda f: f.cost), settings)
    again = [on_problem(problem, f, settings=results.fit).values for f in first]
    return FittedExplanations(
        problem, tuple(fit_all(problem, again, settings.fit_steps, secants=0, settings=results.fit))
    )


def holding_shapes(space: Space, explanations: Sequence[Values]) -> Space:
    """The parameter space with the shape parameters of fitted laws held fixed."""
    fixed = {
        k: v
        for values in explanations
        for k, v in values.items()
        if k.effect != TUNE and BY_NAME[k.effect].port == "law" and _is_shape(k)
    }
    return replace(space, fixed={**space.fixed, **fixed})


def _is_shape(knob: Knob) -> bool:
    return BY_NAME[knob.effect].parameter(knob.parameter).shape


def _weighed(problem: Problem, scales: Scales, best: Fit, settings: ConfirmationSettings) -> Problem:
    """The problem reweighted by the residuals of the best fit; outlying windows are down-weighted."""
    data, results = problem.data, settings.results
    trust = fit_trust(data, scales, data.y - problem.replays([best.values])[0], settings=results.data)
    trusting = problem if (trust == 1.0).all() else replace(problem, count=trust)
    r = trusting.residuals([best.values])[0].reshape(*data.y.shape)
    seen = np.einsum("w,wmc->c", trust, np.isfinite(data.y).astype(float))
    left = np.sqrt(np.einsum("wmc,wmc->c", r, r) / np.maximum(seen, 1.0))
    return replace(reweigh(problem, data.sigma * np.maximum(left, 1.0)), count=trusting.count)
