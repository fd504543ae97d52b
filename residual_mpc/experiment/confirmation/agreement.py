"""How far the numbers that new runs show are from those that a diagnosis lets expect."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from residual_mpc.diagnosis.fit.least_squares import Fit
from residual_mpc.diagnosis.predict.problem import Problem
from residual_mpc.effects.laws import is_law
from residual_mpc.effects.library import BY_NAME
from residual_mpc.experiment.confirmation.known_change import KnownChange, changed_values
from residual_mpc.models.settings import TUNE, Knob, Values


@dataclass(frozen=True)
class Expected:
    """A number that is expected of new runs: its value and 1-sigma, in its unit."""

    value: float
    sigma: float


def expected_numbers(
    values: Values, changes: Sequence[KnownChange], sigma: Mapping[Knob, float], varies: float
) -> dict[Knob, Expected]:
    """Of a model that was diagnosed with these values, after these changes. sigma: as diagnosed, where that is known;
    varies: see ConfirmationSettings. Fitted laws and retuned nominal numbers are left free."""
    changed = changed_values(values, changes)
    out = {}
    for k in {**values, **changed}:
        if k.effect == TUNE or is_law(k.effect):
            continue
        value = changed.get(k, BY_NAME[k.effect].parameter(k.parameter).null)
        if np.isfinite(value):  # a limit that was removed is not at any number
            size = max(dose(k, x) for x in (value, values.get(k, value)))
            out[k] = Expected(value, max(float(np.hypot(sigma.get(k, 0.0), varies * size)), 1e-9))
    return out


def dose(knob: Knob, value: float) -> float:
    """How far a number is from doing nothing; of a limit or a stiffness, its own size."""
    null = BY_NAME[knob.effect].parameter(knob.parameter).null
    return abs(value - null) if np.isfinite(null) else abs(value)


def found_sigma(fit: Fit, phi: float) -> dict[Knob, float]:
    """1-sigma of each free number, from the curvature of the fit; infinite where the runs do not show it. phi:
    dispersion of the residuals."""
    information = _information(fit, phi)
    size = np.sqrt(np.diag(information))
    shown = size > 0.0
    unit = np.where(shown, size, 1.0)
    spread = np.linalg.pinv(information / np.outer(unit, unit), hermitian=True)
    sigma = np.where(shown, np.sqrt(np.maximum(np.diag(spread), 0.0)) / unit, np.inf)
    return dict(zip(fit.knobs, sigma.tolist(), strict=True))


def mismatch(fit: Fit, phi: float, expected: Mapping[Knob, Expected]) -> float:
    """By how much the fit's cost over phi rises, to second order, where the expected numbers count as observations: the
    smallest value of (x - found)' M (x - found) + (x - expected)' W (x - expected), with M the information that the
    runs hold and W that of the expectation."""
    if not any(k in expected for k in fit.knobs):
        return 0.0
    away = np.array([fit.values[k] - expected[k].value if k in expected else 0.0 for k in fit.knobs])
    weight = np.array([1.0 / expected[k].sigma if k in expected else 0.0 for k in fit.knobs])
    # in units of the expectation's sigma, or of the fit's own where nothing is expected
    information = _information(fit, phi)
    unit = np.where(weight > 0.0, weight, np.sqrt(np.maximum(np.diag(information), 1e-300)))
    m, w, d = information / np.outer(unit, unit), np.diag((weight > 0.0).astype(float)), away * weight
    x = np.linalg.lstsq(m + w, -w @ d, rcond=None)[0]
    return float(x @ m @ x + (x + d) @ w @ (x + d))


def score(fit: Fit, phi: float, expected: Mapping[Knob, Expected], as_told: float) -> float:
    """The lowest cost over phi of a model whose numbers count as observed: at what was expected (as_told, the cost
    there), or where the fit ended."""
    return min(as_told / phi, fit.cost / phi + mismatch(fit, phi, expected))


def costs_at(problem: Problem, rows: Sequence[Values]) -> list[float]:
    """The cost of each set of values."""
    if not rows:
        return []
    free = [{k: v for k, v in values.items() if k not in problem.space.fixed} for values in rows]
    return [float(np.sum(r * r)) for r in problem.residuals(free)]


def _information(fit: Fit, phi: float) -> np.ndarray:
    """(P, P) inverse covariance of the numbers, in their own units."""
    j = fit.jacobian.reshape(-1, len(fit.knobs)) / fit.scales
    return np.asarray(j.T @ j / phi)
