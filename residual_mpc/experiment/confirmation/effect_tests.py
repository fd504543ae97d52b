"""Tests of each effect on new runs: whether it is needed and whether it has the expected size."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from residual_mpc.diagnosis.fit.evidence import T95
from residual_mpc.diagnosis.fit.least_squares import Fit, fit_all
from residual_mpc.diagnosis.predict.effect_sets import EffectSet
from residual_mpc.diagnosis.search.stepwise import without
from residual_mpc.effects.laws import is_law
from residual_mpc.effects.library import BY_NAME
from residual_mpc.experiment.confirmation.agreement import (
    Expected,
    costs_at,
    dose,
    expected_numbers,
    found_sigma,
    score,
    sigmas_of,
)
from residual_mpc.experiment.confirmation.inputs import ConfirmationInput
from residual_mpc.experiment.confirmation.known_change import changed_values
from residual_mpc.experiment.confirmation.problem import FittedExplanations
from residual_mpc.experiment.confirmation.records import EffectTest, ExplanationTest, Outcome, Size
from residual_mpc.experiment.confirmation.settings import ConfirmationSettings
from residual_mpc.models.parameter_units import unit_of
from residual_mpc.models.settings import TUNE, Knob, Term, Values


@dataclass(frozen=True, eq=False)
class Scored:
    """The explanations fitted to the new runs. phi: dispersion of the residuals; changed: each explanation's
    diagnosed values with the known changes applied; expected: the same values with their standard deviations; scores:
    see `score`; kept: index of the explanation that is kept."""

    given: ConfirmationInput
    fitted: FittedExplanations
    phi: float
    changed: tuple[Values, ...]
    expected: tuple[dict[Knob, Expected], ...]
    scores: tuple[float, ...]
    kept: int
    settings: ConfirmationSettings


def tested_effects(scored: Scored, explanations: Sequence[ExplanationTest], fits: bool) -> tuple[EffectTest, ...]:
    """The effects that the diagnosis names, then those of the explanation that replaces it. fits: whether the kept
    explanation, refitted, fits the new runs: in a model that fits poorly, an unmodelled effect may mask the one being
    tested, so that nothing is denied."""
    own, kept = explanations[0], explanations[scored.kept]
    new = kept.terms if scored.kept else ()
    stays = [t for t in own.terms if not (scored.kept and t in kept.instead_of)]
    fit, here = scored.fitted.fits[scored.kept], scored.changed[scored.kept]
    there = [t for t in (*stays, *new) if t in fit.terms]
    fewer = fit_all(
        scored.fitted.problem, [without(fit.values, t) for t in there], scored.settings.fit_steps,
        settings=scored.settings.results.fit,
    )  # fmt: skip
    costs = costs_at(scored.fitted.problem, [here, *(without(here, t) for t in there)])
    left = [set(whole_of(e, own)) for k, e in enumerate(explanations) if k != scored.kept and not e.excluded]
    out = []
    for term in (*own.terms, *new):
        if not _testable(term):
            continue
        if term not in there:
            out.append(EffectTest(term, "denies", False, False, own.above, ()))
            continue
        k = there.index(term)
        removed = _Removed(fewer[k], costs[1 + k] / scored.phi, costs[0] / scored.phi)
        test = _tested(scored, term, removed, any(term not in terms for terms in left), term in new)
        out.append(test if fits or test.outcome != "denies" else replace(test, outcome="open"))
    return tuple(out)


def whole_of(explanation: ExplanationTest, own: ExplanationTest) -> EffectSet:
    """All effects of an explanation."""
    if explanation is own:
        return own.terms
    return (*(t for t in own.terms if t not in explanation.instead_of), *explanation.terms)


@dataclass(frozen=True, eq=False)
class _Removed:
    """A model without one effect. fit: to the new runs; cost, cost_with: over phi, at the expected values, without and
    with the effect."""

    fit: Fit
    cost: float
    cost_with: float


def _testable(term: Term) -> bool:
    """Whether the term is a named effect with fitted parameters: fitted laws are no named effects, and outliers have no
    fitted parameters."""
    return term.effect in BY_NAME and BY_NAME[term.effect].fitted and not is_law(term.effect)


def _tested(scored: Scored, term: Term, removed: _Removed, open_: bool, new: bool) -> EffectTest:
    """open_: whether some explanation without this effect is not excluded."""
    fit, expected, doubt = scored.fitted.fits[scored.kept], scored.expected[scored.kept], scored.settings.beyond_doubt
    sizes = _sizes(scored, term, fit, expected)
    shown = any(np.isfinite(s.found_ci95).all() for s in sizes)
    agree = all(s.agrees for s in sizes)
    if any(c.term == term for c in scored.given.changes):
        difference = _after_change(scored, term, removed)
        gone = term not in {k.term for k in scored.changed[scored.kept] if k.effect != TUNE}
        holds = difference > doubt and (agree or gone) and not open_
        outcome: Outcome = "agrees" if holds else "denies" if difference < -doubt else "open"
        return EffectTest(term, outcome, True, new, difference, sizes)
    difference = score(removed.fit, scored.phi, expected, removed.cost * scored.phi) - scored.scores[scored.kept]
    needed, worse = difference > doubt, removed.cost_with - removed.cost
    if needed and not open_:
        outcome = "other size" if not agree else "agrees" if shown and worse < 0.0 else "open"
    else:
        absent = not agree or (_by_cost(term) and worse > doubt)
        outcome = "denies" if absent and not needed else "open"
    return EffectTest(term, outcome, False, new, difference, sizes)


def _by_cost(term: Term) -> bool:
    """Whether derivatives do not tell how much of the effect there is: far from a limit or within a threshold, its
    parameter changes nothing."""
    sizes = [p for p in BY_NAME[term.effect].parameters if not p.shape and not p.optional]
    return any(p.threshold or not np.isfinite(p.null) for p in sizes)


def _after_change(scored: Scored, term: Term, removed: _Removed) -> float:
    """By how much the score of the effect as it was before its known change is higher than that of the effect after
    it."""
    given, phi, values = scored.given, scored.phi, scored.given.explanations[scored.kept].values
    expected, fit = scored.expected[scored.kept], scored.fitted.fits[scored.kept]
    others = [c for c in given.changes if c.term != term]
    before = changed_values(values, others)
    (cost_before,) = costs_at(scored.fitted.problem, [before])
    if _by_cost(term):
        return cost_before / phi - removed.cost_with
    sigma = sigmas_of(given)[scored.kept]
    as_it_was = expected_numbers(values, others, sigma, scored.settings.varies)
    return score(fit, phi, as_it_was, cost_before) - score(fit, phi, expected, removed.cost_with * phi)


def _sizes(scored: Scored, term: Term, fit: Fit, expected: dict[Knob, Expected]) -> tuple[Size, ...]:
    """The parameters that set the size of an effect, not its shape."""
    sigma, robot, out = found_sigma(fit, scored.phi), scored.fitted.problem.space.robot, []
    for k in fit.knobs:
        if k.effect == TUNE or k.term != term or k not in expected:
            continue
        p = BY_NAME[k.effect].parameter(k.parameter)
        if p.shape:
            continue
        wanted, found = expected[k], fit.values[k]
        size = max(dose(k, wanted.value), wanted.sigma / scored.settings.varies)
        law = scored.settings.results.causes.law * dose(k, found)  # no robot obeys the equation exactly
        half = float(np.hypot(T95 * sigma[k], law)) if sigma[k] <= scored.settings.shown * size else np.inf
        margin = T95 * wanted.sigma
        out.append(
            Size(
                k.parameter,
                unit_of(robot, term, p.unit),
                wanted.value,
                (wanted.value - margin, wanted.value + margin),
                found,
                (found - half, found + half),
            )  # fmt: skip
        )
    return tuple(out)
