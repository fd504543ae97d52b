"""The distance between the parameters fitted to new runs and those expected from a diagnosis."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from residual_mpc.diagnosis.fit.least_squares import Fit
from residual_mpc.diagnosis.predict.problem import Problem
from residual_mpc.effects.laws import is_law
from residual_mpc.effects.library import BY_NAME
from residual_mpc.experiment.confirmation.inputs import ConfirmationInput
from residual_mpc.experiment.confirmation.known_change import KnownChange, changed_values
from residual_mpc.models.settings import TUNE, Knob, Values
from residual_mpc.models.size_numbers import ANGLES


@dataclass(frozen=True)
class Expected:
    """The expected value of a parameter on the new runs and its standard deviation, in its unit."""

    value: float
    sigma: float


def expected_numbers(
    values: Values, changes: Sequence[KnownChange], sigma: Mapping[Knob, float], varies: float
) -> dict[Knob, Expected]:
    """Expected parameters of a model that was diagnosed with these values, after these changes. sigma: diagnosed
    standard deviations, where known; varies: see ConfirmationSettings. Fitted laws and retuned nominal parameters have
    no expected value."""
    changed = changed_values(values, changes)
    out = {}
    for k in {**values, **changed}:
        if k.effect == TUNE or is_law(k.effect):
            continue
        value = changed.get(k, BY_NAME[k.effect].parameter(k.parameter).null)
        if not np.isfinite(value) or k.parameter in ANGLES:  # a removed limit; a direction, which has no size
            continue
        size = max(dose(k, x) for x in (value, values.get(k, value)))
        spread = float(np.hypot(sigma.get(k, 0.0), varies * size))
        if spread > 0.0:
            out[k] = Expected(value, spread)
    return out


def sigmas_of(given: ConfirmationInput) -> list[dict[Knob, float]]:
    """The standard deviations of each explanation's parameters: the diagnosed ones, and for what only an alternative
    has, the same relative to its size as the least certain of the effects that it replaces."""
    own = given.explanations[0].values
    out = []
    for e in given.explanations:
        replaced = [k for k in given.sigma if k.term in e.instead_of and k in own and dose(k, own[k]) > 0.0]
        relative = max((given.sigma[k] / dose(k, own[k]) for k in replaced), default=0.0)
        extra = {k: relative * dose(k, v) for k, v in e.values.items() if k.effect != TUNE and k.term in e.terms}
        out.append({**extra, **given.sigma})
    return out


def dose(knob: Knob, value: float) -> float:
    """Distance of a parameter from its null value; of a limit or a stiffness (null at infinity), its magnitude."""
    null = BY_NAME[knob.effect].parameter(knob.parameter).null
    return abs(value - null) if np.isfinite(null) else abs(value)


def found_sigma(fit: Fit, phi: float) -> dict[Knob, float]:
    """Standard deviation of each free parameter, from the curvature of the fit; infinite if the runs do not constrain
    it. phi: dispersion of the residuals."""
    information = _information(fit, phi)
    size = np.sqrt(np.diag(information))
    shown = size > 0.0
    unit = np.where(shown, size, 1.0)
    spread = np.linalg.pinv(information / np.outer(unit, unit), hermitian=True)
    sigma = np.where(shown, np.sqrt(np.maximum(np.diag(spread), 0.0)) / unit, np.inf)
    return dict(zip(fit.knobs, sigma.tolist(), strict=True))


def mismatch(fit: Fit, phi: float, expected: Mapping[Knob, Expected]) -> float:
    """Increase of the fit's cost / phi, to second order, if the expected values are added as observations: the minimum
    over x of (x - found)' M (x - found) + (x - expected)' W (x - expected), with M the information matrix of the runs
    and W that of the expected values."""
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


def score(fit: Fit, phi: float, expected: Mapping[Knob, Expected], at_expected: float) -> float:
    """The smaller of the cost / phi at the expected values, where the cost is at_expected, and the cost / phi of the
    fit plus its mismatch with them."""
    return min(at_expected / phi, fit.cost / phi + mismatch(fit, phi, expected))


def costs_at(problem: Problem, rows: Sequence[Values]) -> list[float]:
    """The cost of each set of values."""
    if not rows:
        return []
    free = [{k: v for k, v in values.items() if k not in problem.space.fixed} for values in rows]
    return [float(np.sum(r * r)) for r in problem.residuals(free)]


def _information(fit: Fit, phi: float) -> np.ndarray:
    """(P, P) information matrix (inverse covariance) of the parameters, in their own units."""
    j = fit.jacobian.reshape(-1, len(fit.knobs)) / fit.scales
    return np.asarray(j.T @ j / phi)
