"""What the baselines share: windows of the runs, a few kept back, and a diagnosis.json out of a fitted set.

They replay with the product's own models and residuals, start uncertainty included: what differs is how a
cause is chosen, and that nothing is doubted.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from residual_mpc.diagnosis.data.constant_velocity import constant_velocity
from residual_mpc.diagnosis.data.dataset import Dataset, build_dataset
from residual_mpc.diagnosis.data.gap import gap_of, measure_scales
from residual_mpc.diagnosis.data.subsampling import thin
from residual_mpc.diagnosis.fit.least_squares import Fit
from residual_mpc.diagnosis.predict.candidates import build_space
from residual_mpc.diagnosis.predict.problem import Problem, build_problem
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.diagnosis.predict.space import Space
from residual_mpc.effects.library import BY_NAME
from residual_mpc.files import write_atomically
from residual_mpc.logs.run import Run
from residual_mpc.models.protocol import Robot
from residual_mpc.models.settings import Term, Values

_LEAST_SHRINK = 0.1  # a baseline that gains less than this on the runs kept back says that there is no gap
_FIT_STEPS = 16_000  # simulation steps that one hypothesis may cost


@dataclass(frozen=True)
class BaselineProblem:
    """The runs as a baseline sees them."""

    fitting: Problem
    kept: Problem
    space: Space
    whole: Dataset
    held: np.ndarray  # (W,) windows of `whole` kept back; all of them where runs are too short for that


Method = Callable[[BaselineProblem], "Fit | None"]


def build_baseline_problem(
    runs: Sequence[Run],
    robots: Sequence[Robot],
    noise: dict[str, float],
    tunable: Sequence[str],
    without: Sequence[str],
) -> BaselineProblem:
    """Cut the runs into windows as the diagnosis does; the last quarter of each run is kept back."""
    whole = build_dataset(runs, robots, noise, 1.0)
    last = np.array([whole.start[whole.run == run].max() for run in whole.run])  # (W,) s
    held = whole.start > 0.75 * last
    held = held if held.any() and not held.all() else np.ones(whole.count, dtype=bool)
    fitting = whole.take(~held) if not held.all() else whole
    space = build_space(fitting, tunable, (), without)
    few, rest = thin(fitting, _FIT_STEPS), whole.take(held)
    fitted, kept = build_problem(few, space, few.sigma), build_problem(rest, space, rest.sigma)
    return BaselineProblem(fitted, kept, space, whole, held)


def cost_on(problem: Problem, values: Values) -> float:
    """Sum of squares of the whitened residuals under ``values``."""
    return float(np.sum(problem.residuals([values])[0] ** 2))


def standard_errors(fit: Fit) -> np.ndarray:
    """(P,) of the knobs in their own units, as ordinary least squares has them: residuals taken as white."""
    jacobian = fit.jacobian.reshape(-1, len(fit.knobs))
    freedom = max(int(np.count_nonzero(fit.r)) - len(fit.knobs), 1)
    variance = np.linalg.pinv(jacobian.T @ jacobian) * fit.cost / freedom
    return np.asarray(np.sqrt(np.maximum(np.diag(variance), 0.0)) * fit.scales)


def document_of(problem: BaselineProblem, fit: Fit | None, robot: str) -> dict[str, Any]:
    """A diagnosis.json with what a baseline knows: no probabilities, no groups, no expectation."""
    scales = measure_scales(problem.whole)

    def gap(values: Values) -> float:
        predicted = predict(problem.whole, problem.space.settings([values]))[0]
        return float(gap_of(problem.whole, scales, problem.whole.y - predicted, problem.held).total)

    steady = problem.whole.y - constant_velocity(problem.whole)
    forecast = float(gap_of(problem.whole, scales, steady, problem.held).total)
    before = gap({})
    after = before if fit is None else gap(fit.values)
    if fit is None or after > (1 - _LEAST_SHRINK) * before:
        fit, after = None, before
    return {
        "schema": "residual-mpc/diagnosis/1",
        "robot": robot,
        "verdict": "no_gap" if fit is None else "effects",
        "held_out": [],
        "gap": {
            "before": before, "after": after, "noise_floor": 0.0, "constant_velocity": forecast, "horizon": 1.0
        },
        "shrink": None if fit is None else {"value": 1 - after / before},
        "explanation": [] if fit is None else _explanation(fit),
        "candidates": [],
        "confounded": [],
        "not_testable": [],
    }


def _explanation(fit: Fit) -> list[dict[str, Any]]:
    errors = standard_errors(fit)
    parts: dict[Term, dict[str, Any]] = {}
    for knob, error in zip(fit.knobs, errors, strict=True):
        if knob.effect not in BY_NAME:
            continue  # a nominal parameter retuned
        value = fit.values[knob]
        figure = {
            "value": value,
            "ci95": [value - 1.96 * error, value + 1.96 * error],
            "unit": BY_NAME[knob.effect].parameter(knob.parameter).unit,
        }
        part = parts.setdefault(knob.term, {"effect": knob.effect, "target": knob.target, "parameters": {}})
        part["parameters"][knob.parameter] = figure
    return list(parts.values())


def write_document(document: dict[str, Any], folder: Path) -> None:
    """Write ``diagnosis.json``."""
    write_atomically(folder / "diagnosis.json", json.dumps(document, indent=1) + "\n")
