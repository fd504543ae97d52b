"""Each effect tested on new runs: whether they need it, and whether it has the size that was expected."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from residual_mpc.diagnosis.fit.least_squares import Fit, fit_all
from residual_mpc.diagnosis.results.causes import T95, unit_of
from residual_mpc.diagnosis.search.stepwise import without
from residual_mpc.effects.laws import is_law
from residual_mpc.effects.library import BY_NAME
from residual_mpc.experiment.confirmation.agreement import (
    Expected,
    costs_at,
    dose,
    expected_numbers,
    found_sigma,
    mismatch,
    score,
)
from residual_mpc.experiment.confirmation.inputs import ConfirmationInput
from residual_mpc.experiment.confirmation.problem import FittedExplanations
from residual_mpc.experiment.confirmation.records import EffectTest, ExplanationTest, Outcome, Size
from residual_mpc.experiment.confirmation.settings import ConfirmationSettings
from residual_mpc.models.settings import TUNE, Knob, Term, Values


@dataclass(frozen=True, eq=False)
class Scored:
    """The explanations fitted to the new runs. phi: dispersion of the residuals; changed: each explanation's values in
    these runs, as told; expected: the same with their uncertainty; scores: see `score`; best: the place of the
    explanation that stands."""

    given: ConfirmationInput
    fitted: FittedExplanations
    phi: float
    changed: tuple[Values, ...]
    expected: tuple[dict[Knob, Expected], ...]
    scores: tuple[float, ...]
    best: int
    settings: ConfirmationSettings


def tested_effects(scored: Scored, explanations: Sequence[ExplanationTest], nominal: float) -> tuple[EffectTest, ...]:
    """The effects that the diagnosis names, then those of the explanation that takes its place. nominal: the gap of the
    nominal model on the new runs."""
    own, best = explanations[0], explanations[scored.best]
    new = best.terms if scored.best else ()
    stays = [t for t in own.terms if not (scored.best and t in best.instead_of)]
    fit = scored.fitted.fits[scored.best]
    there = [t for t in (*stays, *new) if t in fit.terms]
    fewer = fit_all(
        scored.fitted.problem, [without(fit.values, t) for t in there], scored.settings.fit_steps,
        settings=scored.settings.results.fit,
    )  # fmt: skip
    as_told = costs_at(scored.fitted.problem, [without(scored.changed[scored.best], t) for t in there])
    open_ = {t for e in explanations[1:] if not e.excluded for t in e.instead_of} - set(new)
    fits = best.refitted**2 <= (1.0 - scored.settings.explains) * nominal**2
    out = []
    for term in (*own.terms, *new):
        if not _testable(term):
            continue
        if term not in there:
            out.append(EffectTest(term, "denies", False, False, own.ratio, ()))
            continue
        k = there.index(term)
        test = _tested(scored, term, (fewer[k], as_told[k]), term in open_, term in new)
        # what is denied by a model that does not fit may be missed by what it lacks
        out.append(test if fits or test.outcome != "denies" else replace(test, outcome="open"))
    return tuple(out)


def _testable(term: Term) -> bool:
    """Whether the term has a name and numbers: a fitted law has none of the one, outliers none of the other."""
    return term.effect in BY_NAME and BY_NAME[term.effect].fitted and not is_law(term.effect)


def _tested(scored: Scored, term: Term, fewer: tuple[Fit, float], open_: bool, new: bool) -> EffectTest:
    """fewer: the fit without this effect, and the cost of what was told without it; open_: whether another explanation
    without it is not excluded."""
    fit, expected, doubt = scored.fitted.fits[scored.best], scored.expected[scored.best], scored.settings.beyond_doubt
    sizes = _sizes(scored, term, fit, expected)
    agree = all(s.agrees for s in sizes)
    if any(c.term == term for c in scored.given.changes):
        others = [c for c in scored.given.changes if c.term != term]
        before = scored.given.explanations[scored.best].values
        as_it_was = expected_numbers(before, others, scored.given.sigma, scored.settings.varies)
        ratio = mismatch(fit, scored.phi, as_it_was) - mismatch(fit, scored.phi, expected)
        outcome: Outcome = "open"
        if abs(ratio) > doubt:
            outcome = "agrees" if ratio > 0.0 and agree and not open_ else "denies" if ratio < 0.0 else "open"
        return EffectTest(term, outcome, True, new, ratio, sizes)
    fit_without, as_told = fewer
    ratio = score(fit_without, scored.phi, expected, as_told) - scored.scores[scored.best]
    needed = ratio > doubt
    if needed and not open_:
        return EffectTest(term, "agrees" if agree else "other size", False, new, ratio, sizes)
    return EffectTest(term, "open" if agree or needed else "denies", False, new, ratio, sizes)


def _sizes(scored: Scored, term: Term, fit: Fit, expected: dict[Knob, Expected]) -> tuple[Size, ...]:
    """Those numbers of an effect that say how much of it there is."""
    sigma, robot, out = found_sigma(fit, scored.phi), scored.fitted.problem.space.robot, []
    for k in fit.knobs:
        if k.effect == TUNE or k.term != term or k not in expected:
            continue
        p = BY_NAME[k.effect].parameter(k.parameter)
        if p.shape:
            continue
        wanted, found = expected[k], fit.values[k]
        size = max(dose(k, wanted.value), wanted.sigma / scored.settings.varies)
        law = scored.settings.results.causes.law * dose(k, found)  # no robot obeys a law exactly
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
