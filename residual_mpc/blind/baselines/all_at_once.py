"""All parameters fitted at once, and the largest change named: the way of an identification toolbox."""

from __future__ import annotations

import math

import numpy as np

from residual_mpc.blind.baselines.problem import BaselineProblem
from residual_mpc.diagnosis.fit.least_squares import Fit, fit_all
from residual_mpc.models.settings import Term


def all_at_once(problem: BaselineProblem) -> Fit | None:
    """The effect that moved farthest, in its typical steps, when every effect was free at every target."""
    space = problem.space
    start = {}
    for term in _separate(space.candidates):
        for knob in space.knobs(term):
            null, (low, high) = space.null(knob), space.bounds(knob)
            # a limit that the model lacks starts where it does not bite, one that it has at its own
            start[knob] = (space.reached_limit(term) or high) if math.isinf(null) else float(np.clip(null, low, high))
    if not start:
        return None
    fit = fit_all(problem.fitting, [start], 6)[0]
    moved: dict[Term, float] = {}
    for knob in fit.knobs:
        change = abs(fit.values[knob] - start[knob]) / space.scale(knob)
        moved[knob.term] = max(moved.get(knob.term, 0.0), change)
    chosen = max(moved, key=lambda term: moved[term])
    # its value stays the one that the whole set gave it
    keep = [i for i, knob in enumerate(fit.knobs) if knob.term == chosen]
    knobs = tuple(fit.knobs[i] for i in keep)
    return Fit(
        terms=(chosen,),
        knobs=knobs,
        values={knob: fit.values[knob] for knob in knobs},
        scales=fit.scales[keep],
        cost=fit.cost,
        r=fit.r,
        jacobian=fit.jacobian[..., keep],
        held=fit.held[keep],
    )


def _separate(candidates: tuple[Term, ...]) -> list[Term]:
    """Every effect once: at each target where it has some, else on the robot."""
    targeted = {term.effect for term in candidates if term.target is not None}
    return [term for term in candidates if term.target is not None or term.effect not in targeted]
