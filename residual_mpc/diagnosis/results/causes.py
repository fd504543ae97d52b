"""The causes of a diagnosis: each chosen effect with its probability, and its numbers with their intervals."""

import math
from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from residual_mpc.diagnosis.data.outlier_share import expected_jumps
from residual_mpc.diagnosis.fit.evidence import T95, blocks_of, covariance, dispersion, profile_sigma
from residual_mpc.diagnosis.fit.least_squares import Fit
from residual_mpc.diagnosis.fit.polish import carry_on
from residual_mpc.diagnosis.laws.figures import FittedLaw, fitted_law
from residual_mpc.diagnosis.predict.noise_floor import AS_GOOD
from residual_mpc.diagnosis.predict.problem import Problem
from residual_mpc.diagnosis.predict.space import Space
from residual_mpc.diagnosis.results.between_runs import sigma_between_runs
from residual_mpc.diagnosis.results.digital_servo import hidden_inertia
from residual_mpc.diagnosis.results.fitted_explanation import FittedExplanation
from residual_mpc.diagnosis.results.records import Cause, Estimate
from residual_mpc.diagnosis.results.settings import ResultSettings
from residual_mpc.diagnosis.results.step_shift import finely_stepped
from residual_mpc.diagnosis.results.support import Support
from residual_mpc.diagnosis.search.late_partners import LATE, quantity_of
from residual_mpc.diagnosis.search.stepwise import without
from residual_mpc.effects.effect import Parameter
from residual_mpc.effects.laws import is_law
from residual_mpc.effects.library import BY_NAME
from residual_mpc.effects.sensor import SENSOR_OUTLIERS
from residual_mpc.models.parameter_units import unit_of
from residual_mpc.models.settings import TUNE, Knob, Term

ANGLES = ("heading", "phase")  # numbers that come round after a turn
LIMITED = ("output", "turn")  # references of limits that leave smaller signals unchanged
AT_BOUND = "at the bound of its search range"
# The values of each number in fits without one of some effects
ValuesWithout = Callable[[Sequence[Term]], Mapping[Knob, tuple[float, ...]]]


def causes_of(
    of: FittedExplanation,
    unexplained: float,
    sure: float,
    supports: Mapping[Term, Support],
    doubt: Mapping[Term, float],
    values_without: ValuesWithout,
    settings: ResultSettings,
    varying: Container[Term] = (),
) -> tuple[Cause, ...]:
    """unexplained: share of the squared gap beyond the floor that is left; sure: what a cause without a rival gets;
    supports and doubt: of each effect, see `support`; values_without: see `refitted_without`; varying: effects whose
    sizes in parts of the runs are told."""
    final, named = of.final, [t for t in of.final.terms if not is_law(t.effect)]
    spread = _spread(of, varying, settings=settings)
    sized = {t: _estimates(of, t, spread, unexplained, {}, settings=settings) for t in named}
    unsized = {t: _unsized(of.problem.space, t, sized[t], settings) if t in sized else 1.0 for t in doubt}
    factors = {t: doubt[t] * unsized[t] for t in doubt}
    # of an effect that predicts much, a number at its bound doubts the name, not that something is there
    small = {t: factors[t] if supports[t].beside < settings.causes.minor else doubt[t] for t in doubt}
    doubtful = [t for t in final.terms if small[t] < settings.causes.doubtful]
    lacking = values_without(doubtful) if len(final.terms) > 1 and doubtful else {}
    causes = []
    for term in final.terms:
        summary, evidence = BY_NAME[term.effect].summary, supports[term].evidence
        if term not in sized:
            law = _law(of, term, settings=settings)
            causes.append(Cause(term, sure * factors[term], (), summary, None, evidence, law))
            continue
        estimates = _estimates(of, term, spread, unexplained, lacking, settings=settings) if lacking else sized[term]
        slots = of.problem.space.slots[term.effect]
        only = slots[0] if len(slots) == 1 and BY_NAME[term.effect].target in ("actuator", "joint", "body") else None
        probability = sure * of.rivalry.shares.get(term, 1.0) * factors[term]
        causes.append(Cause(term, probability, estimates, summary, only, evidence))
    if of.with_outliers:
        causes.append(_outliers(of, settings=settings))
    return tuple(causes)


@dataclass(frozen=True, eq=False)
class _Spread:
    """What the interval of each number includes. sigma (P,): of each free number; aside: limits with small differences
    elsewhere; others: values in sets that explain as much, with a finer time step, and with mean speeds."""

    sigma: np.ndarray
    aside: Mapping[Knob, tuple[float, ...]]
    others: Mapping[Knob, tuple[float, ...]]


def _spread(of: FittedExplanation, varying: Container[Term], settings: ResultSettings) -> _Spread:
    final, problem = of.final, of.problem
    within = sigmas(problem, final, settings=settings)
    blocks = int(blocks_of(problem.data, settings=settings.fit).max()) + 1
    between = sigma_between_runs(final, problem.data.run, within, blocks, settings=settings)
    sigma = np.where([k.term in varying for k in final.knobs], within, between)
    aside = _aside(of, sigma, settings=settings)
    finer = finely_stepped(problem, final)
    beside = _beside_others(of)
    earlier = _of_mean_speeds(of)
    held = {k: more for k in final.knobs if (more := hidden_inertia(problem.space.robot, k)) > 0.0}
    others = {k: (*beside[k], *([finer[k]] if k in finer else ()), *earlier.get(k, ())) for k in final.knobs}
    others |= {k: (*others[k], final.values[k] + more) for k, more in held.items()}
    return _Spread(sigma, aside, others)


def _estimates(
    of: FittedExplanation,
    term: Term,
    spread: _Spread,
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


def _unsized(space: Space, term: Term, estimates: Sequence[Estimate], settings: ResultSettings) -> float:
    """A factor on the probability of an effect: less where a number rests on a bound, or where it may do nothing."""
    rests = any(e.note == AT_BOUND for e in estimates)
    return settings.causes.resting if rests or _may_be_none(space, term, estimates) else 1.0


def _may_be_none(space: Space, term: Term, estimates: Sequence[Estimate]) -> bool:
    """Whether the interval of each number that says how much an effect does contains that it does nothing (a limit:
    reaches what nothing exceeds), or that of one that is a limit reaches from next to nothing to a multiple of it."""
    effect = BY_NAME[term.effect]
    sizes = [e for e in estimates if not effect.parameter(e.name).shape]
    if any(_anywhere(effect.parameter(e.name), e) for e in sizes):
        return True
    nulls = [_idle(space, Knob(*term[:2], e.name)) for e in sizes]
    limits = [np.isinf(effect.parameter(e.name).null) for e in sizes]  # do nothing from there on
    return bool(sizes) and all(
        null <= e.ci95[1] and (limit or e.ci95[0] <= null) for e, null, limit in zip(sizes, nulls, limits, strict=True)
    )


def _idle(space: Space, knob: Knob) -> float:
    """The value at which a number does nothing in the runs, or from which on: of a limit of outputs the largest."""
    parameter = BY_NAME[knob.effect].parameter(knob.parameter)
    if parameter.reference not in LIMITED or BY_NAME[knob.effect].port == "speed" or np.isfinite(parameter.null):
        return parameter.null
    slots = space.slots[knob.effect] if knob.target is None else (knob.target,)
    return max(space.references.get((parameter.reference, s), np.inf) for s in slots)


def _anywhere(parameter: Parameter, estimate: Estimate) -> bool:
    """Whether a limit, which does less the larger it is, may as well be a tenth of its value or twice that."""
    limit = parameter.reference != "one" and parameter.null > estimate.value > 0.0
    low, high = estimate.ci95
    return limit and low < 0.1 * estimate.value and high > 2.0 * estimate.value


def _law(of: FittedExplanation, term: Term, settings: ResultSettings) -> FittedLaw:
    """The law with its intervals, from the sandwich covariance."""
    final = of.final
    mine = [i for i, k in enumerate(final.knobs) if k.effect != TUNE and k.term == term]
    spread = covariance(final, blocks_of(of.problem.data, settings=settings.fit))[np.ix_(mine, mine)]
    return fitted_law(of.space, term, of.forms[term], final.values, [final.knobs[i] for i in mine], spread)


def sigmas(problem: Problem, final: Fit, settings: ResultSettings) -> np.ndarray:
    """(P,) 1-sigma of each free number: from the sandwich covariance, for a threshold from its cost's profile, and for
    one that rests on a bound from its curvature alone."""
    blocks = blocks_of(problem.data, settings=settings.fit)
    phi = dispersion(final, blocks)
    sigma = np.sqrt(np.maximum(np.diag(covariance(final, blocks)), 0.0))
    curvature = np.einsum("wnp,wnp->p", final.jacobian, final.jacobian)
    alone = final.scales * np.sqrt(phi / np.maximum(curvature, 1e-300))
    return np.maximum(
        np.where(final.held & (curvature > 0.0), alone, sigma),
        profile_sigma(problem, final, phi, settings=settings.fit),
    )


def refitted_without(
    of: FittedExplanation, doubtful: Sequence[Term], steps: int, settings: ResultSettings
) -> dict[Knob, tuple[float, ...]]:
    """Each number's values in the fits without one of these effects, which may well not be there; steps: simulation
    steps that each of the fits takes first."""
    fits = carry_on(of.problem, [without(of.final.values, t) for t in doubtful], steps, settings=settings.fit)
    return {k: tuple(f.values[k] for f in fits if k in f.values) for k in of.final.knobs}


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
    values in sets that explain as much, without a doubtful effect, and with a finer time step, which it includes with
    an interval of the same width."""
    knob, final, space = of.final.knobs[i], of.final, of.problem.space
    value = final.values[knob]
    unit = unit_of(space.robot, knob.term, BY_NAME[knob.effect].parameter(knob.parameter).unit)
    low, high = space.bounds(knob)
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
    rests = rests and not BY_NAME[knob.effect].parameter(knob.parameter).limits
    return Estimate(knob.parameter, value, interval, unit, _note(rests, apart))


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


def _outliers(of: FittedExplanation, settings: ResultSettings) -> Cause:
    """The share of the samples that jump, in the channel where most do, with Wilson's interval for as many independent
    samples as its variance stands for."""
    from scipy.stats import binomtest  # half a second to load, for what few runs have

    outliers, data = of.outliers, of.raw
    channel = max(outliers.shares, key=lambda c: outliers.shares[c])
    flagged = {key: mask for key, mask in outliers.flagged.items() if key[1] == channel}
    sigma = float(data.sigma[data.channels.index(channel)])
    jumps = np.concatenate(list(expected_jumps(data.signals, flagged, sigma).values()))
    share = float(jumps.mean())
    counted = jumps.sum() ** 2 / np.sum(jumps**2)
    proportion = binomtest(round(counted), round(counted / share)).proportion_ci(method="wilson")
    estimate = Estimate("rate", share, (float(proportion.low), float(proportion.high)), "1")
    term = Term(SENSOR_OUTLIERS.name, None)
    return Cause(term, settings.causes.most_sure, (estimate,), BY_NAME[term.effect].summary, None, ("fits",))


def most_sure(
    verdict: str, unexplained: float, times_floor: float, beats_forecast: float, settings: ResultSettings
) -> float:
    """The probability of a cause without a rival: where much is left, something else than the library's effects is at
    work, and what was named may be its shadow. That a gap is too small to matter says nothing of its cause.
    times_floor: the gap that is left over the noise floor, the largest of all horizons; beats_forecast: the share that
    the explained model removes of a constant-velocity forecast's squared gap."""
    tuned = settings.causes
    beyond = float(np.clip(2.0 * (times_floor / AS_GOOD - 1.0), 0.0, 1.0)) if verdict == "effects" else 1.0
    most = 1.0 - (1.0 - tuned.most_partial) * beyond
    shadow = max(most - tuned.shadow * float(np.log(max(times_floor / AS_GOOD, 1.0))), tuned.least_sure)
    useful = max(min(beats_forecast / tuned.useful, 1.0), tuned.least_sure)
    return tuned.most_sure * (1.0 - unexplained) * shadow * useful


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
