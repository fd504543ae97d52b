"""The numbers of a diagnosis, each with an interval that includes the model's own error."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from residual_mpc.diagnosis.fit.evidence import T95, blocks_of, covariance, dispersion, profile_sigma
from residual_mpc.diagnosis.fit.least_squares import Fit
from residual_mpc.diagnosis.predict.problem import Problem
from residual_mpc.diagnosis.predict.space import Space
from residual_mpc.diagnosis.results.between_runs import sigma_between_runs
from residual_mpc.diagnosis.results.digital_servo import hidden_inertia
from residual_mpc.diagnosis.results.fitted_explanation import FittedExplanation
from residual_mpc.diagnosis.results.records import Estimate
from residual_mpc.diagnosis.results.settings import ResultSettings
from residual_mpc.diagnosis.results.step_shift import finely_stepped
from residual_mpc.diagnosis.results.variation_records import Variation
from residual_mpc.diagnosis.search.late_partners import LATE, quantity_of
from residual_mpc.effects.library import BY_NAME
from residual_mpc.models.parameter_units import unit_of
from residual_mpc.models.settings import TUNE, Knob, Term
from residual_mpc.models.size_numbers import ANGLES, size_knobs

AT_BOUND = "at the bound of its search range"
FROM_BELOW = "the runs bound it from below only"


@dataclass(frozen=True, eq=False)
class Spread:
    """What the interval of each number includes. sigma (P,): of each free number; aside: limits with small differences
    elsewhere; others: values in sets that explain as much, beside one more small effect or all optional numbers,
    with a finer time step, and with mean speeds."""

    sigma: np.ndarray
    aside: Mapping[Knob, tuple[float, ...]]
    others: Mapping[Knob, tuple[float, ...]]


def spread_of(of: FittedExplanation, varying: Mapping[Term, Variation], settings: ResultSettings) -> Spread:
    """varying: effects whose sizes in parts of the runs are told; the sizes in single runs are spread as the runs
    disagree, about their own mean too: one long run may have fixed the number."""
    final, problem = of.final, of.problem
    within = sigmas(problem, final, settings=settings)
    blocks = int(blocks_of(problem.data, settings=settings.fit).max()) + 1
    between = sigma_between_runs(final, problem.data.run, within, blocks, settings=settings)
    by_run = {t: tuple(v.by_run.values()) for t, v in varying.items() if v.by_run}
    sigma = np.where([k.term in varying and k.term not in by_run for k in final.knobs], within, between)
    aside = _aside(of, sigma, settings=settings)
    finer = finely_stepped(problem, final)
    beside = _beside_others(of)
    earlier = _of_mean_speeds(of)
    held = {k: more for k in final.knobs if (more := hidden_inertia(problem.space.robot, k)) > 0.0}
    shifted = {k: tuple(final.values[k] + shift[k] for shift in of.omitted) for k in final.knobs}
    others = {
        k: (*beside[k], *shifted[k], *([finer[k]] if k in finer else ()), *earlier.get(k, ())) for k in final.knobs
    }
    others |= {k: (*others[k], final.values[k] + more) for k, more in held.items()}
    for term, sizes in by_run.items():
        knob = size_knobs(final.values, term)[0]
        if term in of.run_sizes and len(sizes) > 1:  # the fit has taken out by how much the runs disagree
            i = final.knobs.index(knob)
            sigma[i] = max(float(sigma[i]), float(np.std(sizes, ddof=1) / np.sqrt(len(sizes))))
        others[knob] = (*others[knob], float(np.mean(sizes)))
    return Spread(sigma, aside, others)


def estimates_of(
    of: FittedExplanation,
    term: Term,
    spread: Spread,
    unexplained: float,
    lacking: Mapping[Knob, tuple[float, ...]],
    settings: ResultSettings,
) -> tuple[Estimate, ...]:
    """The numbers of an effect; lacking: the values of all numbers without a doubtful effect."""
    others = {k: (*spread.others[k], *lacking.get(k, ())) for k in of.final.knobs}
    return tuple(
        _estimate(of, i, float(spread.sigma[i]), unexplained, spread.aside.get(k, ()), others[k], settings=settings)
        for i, k in enumerate(of.final.knobs)
        if k.effect != TUNE and k.term == term
    )


def sigmas(problem: Problem, final: Fit, settings: ResultSettings) -> np.ndarray:
    """(P,) 1-sigma of each free number: from the sandwich covariance, for a threshold from its cost's profile, and for
    one that rests on a bound from its curvature alone. Of a limit beyond the model's own the profile alone counts: a
    limit that is rarely reached has almost no derivative, but the data still bound it from below."""
    blocks = blocks_of(problem.data, settings=settings.fit)
    phi = dispersion(final, blocks)
    sigma = np.sqrt(np.maximum(np.diag(covariance(final, blocks)), 0.0))
    curvature = np.einsum("wnp,wnp->p", final.jacobian, final.jacobian)
    alone = final.scales * np.sqrt(phi / np.maximum(curvature, 1e-300))
    profile = profile_sigma(problem, final, phi, settings=settings.fit)
    own = [problem.space.reached_limit(k.term) if k.effect != TUNE else 0.0 for k in final.knobs]
    raised = np.array([0.0 < limit < final.values[k] for k, limit in zip(final.knobs, own, strict=True)], dtype=bool)
    return np.where(raised, profile, np.maximum(np.where(final.held & (curvature > 0.0), alone, sigma), profile))


def _beside_others(of: FittedExplanation) -> dict[Knob, tuple[float, ...]]:
    """Each number's values in the fits with another member of a confounded group in place of a named effect: which of
    the members is there, these runs do not tell."""
    alike = [r.fit.values for r in of.rivalry.rivals if r.alike]
    return {k: tuple(values[k] for values in alike if k in values) for k in of.final.knobs}


def _of_mean_speeds(of: FittedExplanation) -> dict[Knob, tuple[float]]:
    """A dead time's value where logged speeds are means over the last sample, as differences of an encoder's counts
    are: half a sample late. Only where nothing but speeds is compared; what is measured besides would tell."""
    late = {k: v for k, v in of.final.values.items() if quantity_of(k) in LATE and v > 0.0}
    seen = [of.raw.channels[c] for c in np.flatnonzero(of.raw.compared.any(axis=0))] if late else []
    if not seen or not all(c.startswith("velocity.") for c in seen):
        return {}
    half = 0.5 * float(np.median([run.period for run in of.raw.runs]))
    return {k: (max(v - half, 0.0),) for k, v in late.items()}


def _aside(of: FittedExplanation, sigma: np.ndarray, settings: ResultSettings) -> dict[Knob, tuple[float, float]]:
    """The interval of each number, limits included, shifted and widened as marginalising small differences does; sigma
    (P,): without that."""
    if of.tolerated is None:
        return {}
    wide, plain = of.tolerated.fit, of.tolerated.plain
    assert wide.knobs == plain.knobs == of.final.knobs
    more = sigmas(of.tolerated.problem, wide, settings=settings) ** 2
    same = of.tolerated.part is of.problem
    more -= (sigma if same else sigmas(of.tolerated.part, plain, settings=settings)) ** 2
    half = T95 * np.sqrt(sigma**2 + np.maximum(more, 0.0))
    centre = {k: of.final.values[k] + wide.values[k] - plain.values[k] for k in of.final.knobs}
    return {k: (centre[k] - h, centre[k] + h) for k, h in zip(of.final.knobs, half, strict=True)}


def _estimate(
    of: FittedExplanation,
    i: int,
    sigma: float,
    unexplained: float,
    aside: tuple[float, ...],
    others: tuple[float, ...],
    settings: ResultSettings,
) -> Estimate:
    """aside: limits of the interval with small differences elsewhere, which the stated interval includes; others:
    values in sets that explain as much, beside one more small effect, without a doubtful effect, and with a finer time
    step, which it includes with an interval of the same width."""
    knob, final, space = of.final.knobs[i], of.final, of.problem.space
    value = final.values[knob]
    unit = unit_of(space.robot, knob.term, BY_NAME[knob.effect].parameter(knob.parameter).unit)
    low, high = space.bounds(knob)
    if quantity_of(knob) == "command delay" and value >= 0.0:
        low = 0.0  # only a log can make a delay negative, and this one does not
    ends = of.ends.get(knob, (value,))
    if knob.parameter in ANGLES:
        value, low, high, ends, aside, others = (
            float((value + np.pi) % (2 * np.pi) - np.pi),
            -np.inf,
            np.inf,
            (),
            (),
            (),
        )
    dose, tuned = _dose(space, knob, value), settings.causes
    pulled = tuned.form * np.sqrt(unexplained) * dose
    half = float(np.linalg.norm([T95 * sigma, pulled, tuned.law * dose, _order(final, knob, settings)]))
    apart = max([value + half, *ends]) - min([value - half, *ends]) > tuned.apart * half
    interval = (
        float(max(min([min([value, *others]) - half, *ends, *aside]), min(low, value))),
        float(min(max([max([value, *others]) + half, *ends, *aside]), max(high, value))),
    )
    rests = bool(final.held[i]) or _rests(space, knob, value, interval, settings)
    rests = rests and not BY_NAME[knob.effect].parameter(knob.parameter).physical_bounds
    open_above = 0.0 < space.reached_limit(knob.term) < value and space.bounds(knob)[1] in ends
    return Estimate(knob.parameter, value, interval, unit, FROM_BELOW if open_above else _note(rests, apart))


def _rests(space: Space, knob: Knob, value: float, interval: tuple[float, float], settings: ResultSettings) -> bool:
    """Whether a number came to rest next to a bound, at which its interval ends: the cause may lie beyond."""
    null = space.null(knob)
    return any(
        abs(value - end) <= settings.causes.beside * abs(end - null) and end in interval
        for end in space.bounds(knob)
        if np.isfinite(end) and np.isfinite(null)
    )


def _order(final: Fit, knob: Knob, settings: ResultSettings) -> float:
    """What a dead time and a lag that are both named may take from each other, s: a second-order system is fitted as
    well by less of one and more of the other."""
    own = quantity_of(knob)
    lag = LATE.get(own, own)
    dead = [k for k in final.knobs if LATE.get(quantity_of(k)) == lag]
    slow = [final.values[k] for k in final.knobs if quantity_of(k) == lag]
    return settings.causes.order * max(slow) if dead and slow else 0.0


def _note(held: bool, apart: bool) -> str:
    """What is wrong with a number, in words; empty where nothing is."""
    if held:
        return AT_BOUND
    if apart:
        return "two fits from different starts differ and are equally good"
    return ""


def _dose(space: Space, knob: Knob, value: float) -> float:
    """How far a number is from doing nothing; a limit's and an angle's own size says that better than its distance, and
    that of a gain of a fiftieth, its logarithm; of a number of cycles what moves them by a radian over the range."""
    null = space.null(knob)
    if knob.parameter in ANGLES:
        return 1.0
    if BY_NAME[knob.effect].parameter(knob.parameter).cover:
        return 1.0 / space.turned(knob)
    if null == 1.0 and 0.0 < value < 1.0 / math.e:
        return float((math.e - 1.0) * value * abs(np.log(value)))  # as large as 1 - value at 1 / e
    return abs(value) if not np.isfinite(null) else abs(value - null)
