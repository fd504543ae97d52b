"""The new runs as a fitting problem: windows, hypotheses, and the weights of channels and windows."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from residual_mpc.diagnosis.data.dataset import joined
from residual_mpc.diagnosis.data.subsampling import thin_whole
from residual_mpc.diagnosis.fit.channel_weights import weighed_by_residuals
from residual_mpc.diagnosis.fit.least_squares import Fit, fit_all, on_problem
from residual_mpc.diagnosis.phases.prepare import Prepared
from residual_mpc.diagnosis.predict.longer_steps import on_longer_steps
from residual_mpc.diagnosis.predict.problem import Problem, build_problem
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
    best = min(first, key=lambda f: f.cost)
    problem = weighed_by_residuals(problem, scales, best.values, results.data)
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
