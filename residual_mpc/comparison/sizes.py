"""How large each change is, with an interval that holds what differs between stretches of one set."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import stdtrit

from residual_mpc.comparison.force_scale import force_scales, with_force_scales
from residual_mpc.comparison.records import ChangedNumber
from residual_mpc.comparison.settings import ComparisonSettings
from residual_mpc.comparison.space import ChangeSpace, change_between
from residual_mpc.comparison.units import Units
from residual_mpc.diagnosis.fit.least_squares import Fit, fit_all
from residual_mpc.diagnosis.predict.problem import Problem
from residual_mpc.diagnosis.results.intervals import AT_BOUND
from residual_mpc.diagnosis.results.settings import ResultSettings
from residual_mpc.effects.library import BY_NAME
from residual_mpc.models.parameter_units import unit_of
from residual_mpc.models.settings import Knob, Term, Values

TINY = 1e-30
MOST = 2.0  # half of an interval that model errors alone can give, relative to the change


@dataclass(frozen=True, eq=False)
class Spread:
    """sigma (P,): standard deviation of each number of a fit, from the fits without one unit each (the jackknife; Efron
    and Stein 1981); freedom (P,): degrees of freedom that the units' shares in it tell (Satterthwaite 1946)."""

    sigma: np.ndarray
    freedom: np.ndarray


def jackknife(fit: Fit, units: Units) -> Spread:
    """By one Gauss-Newton step from the whole fit. Units of the two sets are left out in turn, so that the difference
    between them is as uncertain as they differ within each set."""
    count, size = units.count, len(fit.knobs)
    free = ~fit.held
    j = fit.jacobian[..., free]
    products = units.summed(np.einsum("wnp,wnq->wpq", j, j, optimize=True))
    scores = units.summed(np.einsum("wnp,wn->wp", j, fit.r))
    total, whole = products.sum(axis=0), scores.sum(axis=0)
    here = -np.linalg.pinv(total, rcond=1e-10, hermitian=True) @ whole
    without = np.stack(
        [-np.linalg.pinv(total - products[u], rcond=1e-10, hermitian=True) @ (whole - scores[u]) for u in range(count)]
    )
    share = np.zeros((count, j.shape[2]))
    for side in (units.later, ~units.later):
        n = int(side.sum())
        share[side] = (without[side] - here) ** 2 * (n - 1) / max(n, 1)
    variance = share.sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        freedom = np.where(variance > 0.0, variance**2 / np.sum(share**2, axis=0), count)
    sigma, dof = np.zeros(size), np.full(size, float(count))
    sigma[free] = np.sqrt(variance) * fit.scales[free]
    dof[free] = np.clip(freedom, 1.5, None)
    return Spread(sigma, dof)


def least_half(problem: Problem, fit: Fit, term: Term, settings: ComparisonSettings) -> float:
    """Half of an interval at least, relative to the change.

    Fits without one unit do not show what the model's errors do to a change in all units alike. With residuals r, of
    which the sensors' noise explains the squares n, and the change's own contribution d, errors in the direction of d
    would move its size by sqrt(|r|^2 - n) / |d|; an interval allows for a part of that.
    """
    space = problem.space
    assert isinstance(space, ChangeSpace)
    after = space.later(fit.values)
    caused = np.zeros(fit.r.shape)
    for i, knob in enumerate(fit.knobs):
        if knob.changed and knob.term == term and not BY_NAME[knob.effect].parameter(knob.parameter).shape:
            place = _shown_by(space, fit, i, after)
            size = _moved(knob, fit.values, after, as_factor=place == i)
            caused += fit.jacobian[..., place] * (size / fit.scales[place])
    noise = np.broadcast_to((problem.data.sigma * problem.weight) ** 2, problem.data.y.shape).reshape(fit.r.shape)
    beyond = max(fit.cost - float(noise[fit.r != 0.0].sum()), 0.0)
    errors = np.sqrt(beyond / max(float(np.sum(caused**2)), TINY))
    return float(np.hypot(settings.results.causes.law, min(settings.hidden * errors, MOST)))


def _shown_by(space: ChangeSpace, fit: Fit, place: int, after: Values) -> int:
    """The place of the number that says how well a changed one is known: its own, or, where that has come to a bound,
    that of the same number on both sets: it is as uncertain as it was before."""
    knob = fit.knobs[place]
    own, general = Knob(knob.effect, knob.target, knob.parameter), Knob(knob.effect, None, knob.parameter)
    if not fit.held[place] and after[own] not in space.later_bounds(own):
        return place
    return next((fit.knobs.index(k) for k in (own, general) if k in fit.knobs), place)


def _moved(knob: Knob, values: Values, after: Values, as_factor: bool) -> float:
    """By how much a change moves its number, or the factor that multiplies it; a limit that was not there before: all
    of it."""
    p = BY_NAME[knob.effect].parameter(knob.parameter)
    own, general = Knob(knob.effect, knob.target, knob.parameter), Knob(knob.effect, None, knob.parameter)
    was, now = values.get(own, values.get(general, p.null)), after[own]
    if not np.isfinite(was):
        return now
    return now / was - 1.0 if as_factor and p.null == 1.0 else now - was


def changed_numbers(problem: Problem, fit: Fit, term: Term, spread: Spread, law: float) -> tuple[ChangedNumber, ...]:
    """The numbers of one change; law: half of an interval at least, relative to the change."""
    space = problem.space
    assert isinstance(space, ChangeSpace)
    after, scales = space.later(fit.values), force_scales(space.robot, fit.values, term)
    out = []
    for i, knob in enumerate(fit.knobs):
        if not knob.changed or knob.term != term:
            continue
        p = BY_NAME[knob.effect].parameter(knob.parameter)
        own, general = Knob(knob.effect, knob.target, knob.parameter), Knob(knob.effect, None, knob.parameter)
        was = fit.values.get(own, fit.values.get(general, p.null))
        now = after[own]
        if p.shape and not _there_before(fit.values, knob):
            was = np.nan  # how an effect acts that was not there
        value = fit.values[knob] if p.shape else change_between(p, was, now)
        low, high = space.later_bounds(own)
        held = bool(fit.held[i] or now in (low, high))
        known = _shown_by(space, fit, i, after)
        half = float(stdtrit(spread.freedom[known], 0.975) * spread.sigma[known])
        ratio = p.null == 1.0 or (not np.isfinite(p.null) and np.isfinite(was))
        if ratio and p.null != 1.0:
            half /= was
        half = float(np.hypot(half, law * abs(value - float(ratio))))
        unit = unit_of(space.robot, term, "1" if ratio else p.unit)
        out.append(
            ChangedNumber(
                p.name,
                float(was) if np.isfinite(was) else None,
                float(now) if np.isfinite(now) else None,
                float(value),
                with_force_scales((float(value - half), float(value + half)), unit, scales),
                unit,
                AT_BOUND if held and now != p.null else "",  # an effect that is gone ends at no bound
                None if p.shape else float(ratio),
            )
        )
    return tuple(out)


def _there_before(values: Values, knob: Knob) -> bool:
    """Whether both sets have the effect of a changed number, on its target or on all."""
    sizes = [k for k in values if k.effect == knob.effect and not k.changed and k.target in (knob.target, None)]
    of = BY_NAME[knob.effect]
    return any(not of.parameter(k.parameter).shape and values[k] != of.parameter(k.parameter).null for k in sizes)


def came_to_nothing(fit: Fit, space: ChangeSpace, term: Term) -> bool:
    """Whether the last fit has left a change without a size: each of its numbers is the same before and after."""
    after = space.later(fit.values)
    ends = []
    for knob in fit.knobs:
        p = None if not knob.changed or knob.term != term else BY_NAME[knob.effect].parameter(knob.parameter)
        if p is not None and not p.shape:
            own, general = Knob(knob.effect, knob.target, knob.parameter), Knob(knob.effect, None, knob.parameter)
            ends.append((fit.values.get(own, fit.values.get(general, p.null)), after[own]))
    return bool(ends) and all(np.isclose(was, now, rtol=1e-6, atol=1e-12) for was, now in ends)


def to_the_end(problem: Problem, fit: Fit, settings: ResultSettings) -> Fit:
    """The fit on these windows, to the end, with its Jacobian."""
    ends = fit_all(problem, [fit.values], settings.fit.polish.steps, 1e-6, secants=0, settings=settings.fit)
    return replace(ends[0], terms=fit.terms)
