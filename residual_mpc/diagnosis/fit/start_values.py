"""Values of a hypothesis that a fit may start from: what its effects can have, and another place than the first."""

import numpy as np

from residual_mpc.diagnosis.fit.settings import FitSettings
from residual_mpc.diagnosis.predict.problem import Problem
from residual_mpc.effects.library import BY_NAME
from residual_mpc.models.settings import TUNE, Values


def elsewhere(problem: Problem, start: Values, settings: FitSettings) -> Values | None:
    """Another place to start from: every effect's number moved by a few typical steps, away from its null in turn
    with towards it, and turned back at a bound; None where there is no effect."""
    moved = dict(start)
    sign = 1.0
    for knob, value in start.items():
        if knob.effect == TUNE:
            continue
        low, high = problem.space.bounds(knob)
        step = settings.least_squares.elsewhere * problem.space.scale(knob)
        parameter = BY_NAME[knob.effect].parameter(knob.parameter)
        if parameter.null == 1.0 or not np.isfinite(parameter.null):
            step = min(step, 0.3 * abs(value))  # a ratio or a limit keeps its order of magnitude
        target = value + sign * step
        if not low <= target <= high:
            target = value - sign * step
        moved[knob] = float(np.clip(target, low, high))
        sign = -sign
    return None if moved == dict(start) else moved


def possible(values: Values) -> bool:
    """Whether every term has values that its effect can physically have."""
    for term in {k.term for k in values if k.effect != TUNE}:
        check = BY_NAME[term.effect].sensible
        if check is not None and not check({k.parameter: v for k, v in values.items() if k.term == term}):
            return False
    return True
