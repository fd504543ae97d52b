"""The causes of a diagnosis: each chosen effect with its probability and its numbers."""

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType

import numpy as np

from residual_mpc.diagnosis.data.outlier_share import expected_jumps
from residual_mpc.diagnosis.fit.evidence import blocks_of, covariance
from residual_mpc.diagnosis.fit.polish import carry_on
from residual_mpc.diagnosis.laws.figures import FittedLaw, fitted_law
from residual_mpc.diagnosis.predict.noise_floor import AS_GOOD
from residual_mpc.diagnosis.predict.space import Space
from residual_mpc.diagnosis.results.fitted_explanation import FittedExplanation
from residual_mpc.diagnosis.results.intervals import AT_BOUND, estimates_of, spread_of
from residual_mpc.diagnosis.results.readjusted import readjusted
from residual_mpc.diagnosis.results.records import Cause, Estimate
from residual_mpc.diagnosis.results.settings import ResultSettings
from residual_mpc.diagnosis.results.support import Support
from residual_mpc.diagnosis.results.variation_records import Variation
from residual_mpc.effects.effect import Parameter
from residual_mpc.effects.laws import is_law
from residual_mpc.effects.library import BY_NAME
from residual_mpc.effects.sensor import SENSOR_OUTLIERS
from residual_mpc.models.settings import TUNE, Knob, Term

NO_VARIATION: Mapping[Term, Variation] = MappingProxyType({})
LIMITED = ("output", "turn")  # references of limits that leave smaller signals unchanged
# The values of each number in fits without one of some effects
ValuesWithout = Callable[[Sequence[Term]], Mapping[Knob, tuple[float, ...]]]


def causes_of(
    of: FittedExplanation,
    unexplained: float,
    sure: Mapping[Term, float],
    supports: Mapping[Term, Support],
    doubt: Mapping[Term, float],
    values_without: ValuesWithout,
    settings: ResultSettings,
    varying: Mapping[Term, Variation] = NO_VARIATION,
) -> tuple[Cause, ...]:
    """unexplained: share of the squared gap beyond the floor that is left; sure: what each effect gets without a rival;
    supports and doubt: of each effect, see `support`; values_without: see `refitted_without`; varying: effects whose
    sizes in parts of the runs are told."""
    final, named = of.final, [t for t in of.final.terms if not is_law(t.effect)]
    spread = spread_of(of, varying, settings=settings)
    sized = {t: estimates_of(of, t, spread, unexplained, {}, settings=settings) for t in named}
    doubtful = _doubtful(of, sized, supports, doubt, settings)
    lacking = values_without(doubtful) if len(final.terms) > 1 and doubtful else {}
    causes = []
    for term in final.terms:
        summary, evidence = BY_NAME[term.effect].summary, supports[term].evidence
        if term not in sized:
            law = _law(of, term, spread.sigma, settings=settings)
            causes.append(Cause(term, sure[term] * doubt[term], (), summary, None, evidence, law))
            continue
        estimates = estimates_of(of, term, spread, unexplained, lacking, settings=settings) if lacking else sized[term]
        by_number = _doubt_by_numbers(of, term, estimates, settings)
        slots = of.problem.space.slots[term.effect]
        only = slots[0] if len(slots) == 1 and BY_NAME[term.effect].target in ("actuator", "joint", "body") else None
        probability = sure[term] * of.rivalry.shares.get(term, 1.0) * doubt[term] * by_number
        causes.append(Cause(term, probability, estimates, summary, only, evidence))
    if of.with_outliers:
        causes.append(_outliers(of, settings=settings))
    return tuple(causes)


def _doubtful(
    of: FittedExplanation,
    sized: Mapping[Term, Sequence[Estimate]],
    supports: Mapping[Term, Support],
    doubt: Mapping[Term, float],
    settings: ResultSettings,
) -> list[Term]:
    """The effects that may well not be there, beside which the numbers of the others are not sure either."""
    found = []
    for term in of.final.terms:
        factor = doubt[term]
        # of an effect that predicts much, a number at its bound doubts the name, not that something is there
        if term in sized and supports[term].beside < settings.causes.minor:
            factor *= _doubt_by_numbers(of, term, sized[term], settings)
        if factor < settings.causes.doubtful:
            found.append(term)
    return found


def doubts_by_numbers(
    of: FittedExplanation, unexplained: float, varying: Mapping[Term, Variation], settings: ResultSettings
) -> dict[Term, float]:
    """A factor on the probability of each effect of the library, for its numbers."""
    spread = spread_of(of, varying, settings=settings)
    return {
        t: _doubt_by_numbers(of, t, estimates_of(of, t, spread, unexplained, {}, settings=settings), settings)
        for t in of.final.terms
        if not is_law(t.effect)
    }


def _doubt_by_numbers(
    of: FittedExplanation, term: Term, estimates: Sequence[Estimate], settings: ResultSettings
) -> float:
    """A factor on the probability of an effect: less where a number rests on a bound, or where it may do nothing. One
    that may do nothing in some runs, with its own size in each, does something in others."""
    rests = any(e.note == AT_BOUND for e in estimates)
    nothing = term not in of.run_sizes and _may_be_none(of.problem.space, term, estimates)
    return settings.causes.resting if rests or nothing else 1.0


def _may_be_none(space: Space, term: Term, estimates: Sequence[Estimate]) -> bool:
    """Whether the interval of each number that says how much an effect does contains that it does nothing (a limit:
    reaches what nothing exceeds), or that of one that is a limit reaches from next to nothing to a multiple of it."""
    effect = BY_NAME[term.effect]
    sizes = [e for e in estimates if not effect.parameter(e.name).shape]
    if any(_anywhere(effect.parameter(e.name), e) for e in sizes):
        return True
    nulls = [_idle(space, Knob(*term[:2], e.name)) for e in sizes]
    # a limit does nothing from there on, unless it lies beyond one that the model itself reaches
    limits = [np.isinf(effect.parameter(e.name).null) and not space.reached_limit(term) for e in sizes]
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


def _law(of: FittedExplanation, term: Term, sigma: np.ndarray, settings: ResultSettings) -> FittedLaw:
    """The law with its intervals, from the sandwich covariance, widened by how far the runs disagree; sigma (P,): of
    each free number, with that."""
    final = of.final
    mine = [i for i, k in enumerate(final.knobs) if k.effect != TUNE and k.term == term]
    spread = covariance(final, blocks_of(of.problem.data, settings=settings.fit))[np.ix_(mine, mine)]
    within = np.sqrt(np.maximum(np.diag(spread), 1e-300))
    wider = np.maximum(sigma[mine] / within, 1.0)
    spread = spread * wider[:, None] * wider[None, :]
    return fitted_law(of.space, term, of.forms[term], final.values, [final.knobs[i] for i in mine], spread)


def refitted_without(
    of: FittedExplanation, doubtful: Sequence[Term], steps: int, settings: ResultSettings
) -> dict[Knob, tuple[float, ...]]:
    """Each number's values in the fits without one of these effects, which may well not be there; steps: simulation
    steps that each of the fits takes first. They begin where the others compensate for it: a dead time that has to take
    over a lag may get stuck in local minima of its cost on the way."""
    begun = readjusted(of.problem, of.final)
    fits = carry_on(of.problem, [begun[t] for t in doubtful], steps, settings=settings.fit)
    return {k: tuple(f.values[k] for f in fits if k in f.values) for k in of.final.knobs}


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
    verdict: str,
    unexplained: float,
    times_floor: float,
    beats_forecast: float,
    settings: ResultSettings,
    standing: float = 0.0,
) -> float:
    """The probability of a cause without a rival. Where much is left, something else than the library's effects is at
    work, and what was named may be its shadow, unless it makes far more of the motion than that. That a gap is too
    small to matter says nothing of its cause. times_floor: the gap that is left over the noise floor, the largest of
    all horizons; beats_forecast: the share that the explained model removes of a constant-velocity forecast's squared
    gap; standing: see `Support`."""
    tuned = settings.causes
    told = times_floor / AS_GOOD  # 1: as much as the sensors can tell from nothing
    beyond = float(np.clip((told - tuned.nothing) / (1.0 - tuned.nothing), 0.0, 1.0)) if verdict == "effects" else 1.0
    most = 1.0 - (1.0 - tuned.most_partial) * beyond
    shadow = max(most - tuned.shadow * float(np.log(max(times_floor / AS_GOOD, 1.0))), tuned.least_sure)
    useful = max(min(beats_forecast / tuned.useful, 1.0), tuned.least_sure)
    least = (1.0 - unexplained) * shadow
    low, high = tuned.standing_low, tuned.standing_high
    rank = np.log(max(standing / low, 1.0)) / np.log(high / low)
    return tuned.most_sure * (least + (most - least) * min(float(rank), 1.0)) * useful
