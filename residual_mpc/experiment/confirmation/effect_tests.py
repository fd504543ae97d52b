"""Tests of each effect on new runs: whether it is needed and whether it has the expected size."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from residual_mpc.diagnosis.fit.evidence import T95
from residual_mpc.diagnosis.fit.least_squares import Fit, fit_all
from residual_mpc.diagnosis.predict.effect_sets import EffectSet, without
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
from residual_mpc.experiment.confirmation.known_change import KnownChange, changed_values
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


@dataclass(frozen=True)
class Quality:
    """How well the kept explanation, refitted, fits the new runs. most: whether it removes most of the nominal model's
    squared gap; where it does not, an unmodelled effect may mask the one being tested, and nothing is denied. whole:
    whether it is as good as the sensors can tell; where it is not, an unmodelled effect may look like the one being
    tested on these runs as on the diagnosed ones, and only a known change confirms anything."""

    most: bool
    whole: bool


def tested_effects(scored: Scored, explanations: Sequence[ExplanationTest], quality: Quality) -> tuple[EffectTest, ...]:
    """The effects that the diagnosis names, then those of the explanation that replaces it."""
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
        out.append(test if _may_be_told(test, quality) else replace(test, outcome="open"))
    return tuple(out)


def _may_be_told(test: EffectTest, quality: Quality) -> bool:
    """Whether the model fits well enough for this outcome."""
    if test.outcome == "denies":
        return quality.most
    if test.outcome == "other size":
        return quality.most if test.changed else quality.whole
    return test.changed or quality.whole


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
        was = {s.name: s.agrees for s in _sizes(scored, term, fit, _as_it_was(scored, term))}
        changed = {c.knob.parameter for c in scored.given.changes if c.term == term and c.amount is not None}
        neither = any(not s.agrees and not was.get(s.name, True) for s in sizes if not changed or s.name in changed)
        needed = (removed.fit.cost - fit.cost) / scored.phi > doubt
        if shown and needed and neither and not open_:
            outcome: Outcome = "other size"
        elif difference > doubt and (agree or _gone(scored, term)) and not open_:
            outcome = "agrees"
        else:
            outcome = "denies" if difference < -doubt else "open"
        return EffectTest(term, outcome, True, new, difference, sizes)
    difference = score(removed.fit, scored.phi, expected, removed.cost * scored.phi) - scored.scores[scored.kept]
    needed, worse = difference > doubt, removed.cost_with - removed.cost
    if needed and not open_:
        outcome = "other size" if not agree else "agrees" if shown and worse < 0.0 else "open"
    else:
        absent = not agree or (_by_cost(term) and worse > doubt)
        outcome = "denies" if absent and not needed else "open"
    return EffectTest(term, outcome, False, new, difference, sizes)


def _gone(scored: Scored, term: Term) -> bool:
    """Whether the known changes remove it."""
    return term not in {k.term for k in scored.changed[scored.kept] if k.effect != TUNE}


def _as_it_was(scored: Scored, term: Term) -> dict[Knob, Expected]:
    """The expected numbers if this effect had not changed."""
    given = scored.given
    values, sigma = given.explanations[scored.kept].values, sigmas_of(given)[scored.kept]
    return expected_numbers(values, _others(scored, term), sigma, scored.settings.varies)


def _others(scored: Scored, term: Term) -> list[KnownChange]:
    """The known changes of other effects."""
    return [c for c in scored.given.changes if c.term != term]


def _by_cost(term: Term) -> bool:
    """Whether derivatives do not tell how much of the effect there is: far from a limit or within a threshold, its
    parameter changes nothing."""
    sizes = [p for p in BY_NAME[term.effect].parameters if not p.shape and not p.optional]
    return any(p.threshold or not np.isfinite(p.null) for p in sizes)


def _after_change(scored: Scored, term: Term, removed: _Removed) -> float:
    """By how much the score of the effect as it was before its known change is higher than that of the effect after
    it."""
    phi, values = scored.phi, scored.given.explanations[scored.kept].values
    expected, fit = scored.expected[scored.kept], scored.fitted.fits[scored.kept]
    before = changed_values(values, _others(scored, term))
    (cost_before,) = costs_at(scored.fitted.problem, [before])
    if _by_cost(term):
        return cost_before / phi - removed.cost_with
    return score(fit, phi, _as_it_was(scored, term), cost_before) - score(fit, phi, expected, removed.cost_with * phi)


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
