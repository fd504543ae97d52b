"""The changes that an answer names, with their probabilities, and what could stand in their place."""

import math
from collections.abc import Mapping

import numpy as np
from scipy.special import ndtr

from residual_mpc.comparison.records import Change, ChangeCandidate, Predicted
from residual_mpc.comparison.rivals import ChangeRivals
from residual_mpc.comparison.search import FoundChange
from residual_mpc.comparison.settings import ComparisonSettings
from residual_mpc.comparison.sizes import Spread, changed_numbers, least_half
from residual_mpc.diagnosis.fit.least_squares import Fit
from residual_mpc.diagnosis.predict.problem import Problem
from residual_mpc.effects.library import BY_NAME
from residual_mpc.models.settings import Term


def named_changes(
    problem: Problem,
    fit: Fit,
    rivals: ChangeRivals,
    spread: Spread,
    predicted: Mapping[Term, Predicted],
    sure: float,
    settings: ComparisonSettings,
) -> tuple[Change, ...]:
    """The changes with their sizes, what explains most first; predicted: of each, what it predicts; sure: the largest
    probability of one."""
    out = []
    for c in sorted(rivals.found.changes, key=lambda c: -rivals.parts.get(c.term, 1.0)):
        effect, slots = BY_NAME[c.term.effect], problem.space.slots[c.term.effect]
        only = slots[0] if len(slots) == 1 and effect.target in ("actuator", "joint", "body") else None
        by_fit = min(
            1.0 - c.by_fit, settings.doubtful / max(sure, 1e-9)
        )  # what its fit alone shows is no more than possible
        tested = beside_chance(c.p)
        if c.p <= settings.contrast.level:
            tested = max(tested, beside_chance(p_of_prediction(predicted.get(c.term))))
        probability = sure * rivals.shares.get(c.term, 1.0) * max(tested, by_fit)
        numbers = changed_numbers(problem, fit, c.term, spread, least_half(problem, fit, c.term, settings))
        unsized = any(n.note for n in numbers) or all(n.may_be_none for n in numbers)
        if c.by_fit_alone or unsized or rivals.parts.get(c.term, 1.0) < settings.faint:
            probability = min(probability, settings.doubtful)
        out.append(Change(plain(c.term), probability, c.p, numbers, effect.summary, only))
    return tuple(out)


def beside_chance(p: float) -> float:
    """The largest probability that a p value leaves to a cause against chance, if both were as likely before: -e p ln p
    bounds the Bayes factor from below (Sellke, Bayarri and Berger 2001, eq. 3). Above 1 / e, where that says nothing,
    it falls in proportion to 1 - p."""
    if p >= 1.0 / math.e:
        return 0.5 * (1.0 - p) / (1.0 - 1.0 / math.e)
    return float(1.0 / (1.0 - math.e * p * np.log(max(p, 1e-300))))


def p_of_prediction(predicted: Predicted | None) -> float:
    """Of a gain as large as that of a change on windows that its numbers were not fitted to, from one that predicts
    nothing."""
    return 1.0 if predicted is None else float(ndtr(-predicted.gain / max(predicted.error, 1e-300)))


def may_be_none(
    problem: Problem, fit: Fit, change: FoundChange, rivals: ChangeRivals, spread: Spread, settings: ComparisonSettings
) -> bool:
    """Whether every interval of a change includes "unchanged" and the change is either faint, explaining next to
    nothing of what all explain, or not significant enough for a change of unknown size, by its own test or by its fit:
    two sets of the same robot occasionally differ at the level of a change, but then rarely by a definite size."""
    doubted = min(change.p, change.by_fit) > settings.contrast.unsized
    if rivals.parts.get(change.term, 1.0) >= settings.faint and not doubted:
        return False
    half = least_half(problem, fit, change.term, settings)
    return all(n.may_be_none for n in changed_numbers(problem, fit, change.term, spread, half))


def other_candidates(rivals: ChangeRivals, sure: float) -> list[ChangeCandidate]:
    """What could stand in place of the changes, most probable first."""
    named = {c.term for c in rivals.found.changes}
    told = {c.term: c.p for c in sorted(rivals.found.left.told, key=lambda c: abs(c.z))}
    shares = sorted(rivals.shares.items(), key=lambda item: -item[1])
    return [ChangeCandidate(plain(t), sure * share, told.get(t, 1.0)) for t, share in shares if t not in named]


def plain(term: Term) -> Term:
    """The effect that changed."""
    return term._replace(changed=False)
