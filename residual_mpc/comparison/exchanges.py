"""Two changes in place of two others.

A forward search that begins with the wrong change compensates for it with a second wrong one, and exchanging only one
does not help: neither of the right changes fits beside a wrong partner. Pairs are therefore removed together. For
every other pair, one Gauss-Newton step along both directions (Nocedal and Wright 2006, eq. 10.23) predicts the cost
that remains, and the best pairs are fitted.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from residual_mpc.comparison.leads import changed_terms, scaled_probe, without_change
from residual_mpc.comparison.search import FoundChange, FoundChanges, probes_of
from residual_mpc.comparison.settings import ComparisonSettings
from residual_mpc.comparison.units import Units
from residual_mpc.diagnosis.fit.evidence import dispersion
from residual_mpc.diagnosis.fit.least_squares import Fit, fit_all, possible
from residual_mpc.diagnosis.predict.problem import Problem
from residual_mpc.models.settings import Knob, Term, Values

ROWS = 48  # hypotheses replayed at once, to limit memory use
PARALLEL = 1e-4  # 1 - squared cosine of two directions, below which they count as one
TINY = 1e-30


@dataclass(frozen=True)
class Exchange:
    """gone: the removed changes; base: the values without them; probes: the changes that replace them, of the terms
    `terms`, with the factors `doses` by which the step scales them; cost: the cost that the step predicts."""

    gone: frozenset[Term]
    base: Values
    probes: tuple[Values, Values]
    terms: tuple[Term, Term]
    doses: tuple[float, float]
    cost: float


def exchanged(problem: Problem, found: FoundChanges, units: Units, settings: ComparisonSettings) -> FoundChanges:
    """The changes, two exchanged for two others as long as that explains more by at least `settings.search.needed`."""
    for _ in range(settings.search.most):
        better = _exchanged_once(problem, found, units, settings) if len(found.changes) > 1 else None
        if better is None:
            return found
        found = better
    return found


def _exchanged_once(
    problem: Problem, found: FoundChanges, units: Units, settings: ComparisonSettings
) -> FoundChanges | None:
    tuned, fits = settings.search, settings.results.fit
    chosen = _predicted_best(problem, found, settings)
    rough = fit_all(problem, [_start(problem, e) for e in chosen], tuned.rough, rough=True, settings=fits)
    order = sorted(range(len(rough)), key=lambda i: rough[i].cost)[: tuned.finalists]
    ends = fit_all(problem, [rough[i].values for i in order], settings=fits)
    possible_ends = [(fit, chosen[i]) for fit, i in zip(ends, order, strict=True) if possible(fit.values)]
    if not possible_ends:
        return None
    fit, exchange = min(possible_ends, key=lambda end: end[0].cost)
    more = (len(fit.knobs) - len(found.fit.knobs)) * float(np.log(units.count))
    if (found.fit.cost - fit.cost) / found.phi - more < tuned.needed:
        return None
    return replace(found, fit=fit, changes=_in_their_places(found, exchange), phi=dispersion(fit, units.number))


def _in_their_places(found: FoundChanges, exchange: Exchange) -> tuple[FoundChange, ...]:
    """The changes with the new pair, each as significant as the less significant of the two that it replaces: both
    pairs explain the same difference."""
    gone = [c for c in found.changes if c.term in exchange.gone]
    kept = [c for c in found.changes if c.term not in exchange.gone]
    p, by_fit = max(c.p for c in gone), max(c.by_fit for c in gone)
    by_fit_alone = any(c.by_fit_alone for c in gone)
    return (*kept, *(FoundChange(term, p, by_fit, by_fit_alone) for term in exchange.terms))


def _predicted_best(problem: Problem, found: FoundChanges, settings: ComparisonSettings) -> list[Exchange]:
    """The exchanges that may explain more, in order of increasing predicted cost."""
    probes = probes_of(problem, found.fit)
    moves = _moves(problem, found.fit, [probe for _, probe in probes])
    out = []
    for gone, rest in _without_two(problem, found, settings):
        out += _exchanges(problem, gone, rest, probes, moves, settings.search.exchanges * found.fit.cost)
    return sorted(out, key=lambda e: e.cost)[: settings.search.shortlist]


def _without_two(
    problem: Problem, found: FoundChanges, settings: ComparisonSettings
) -> list[tuple[frozenset[Term], Fit]]:
    """Every pair of changes, and the fit without it."""
    twos = list(combinations((c.term for c in found.changes), 2))
    starts = [without_change(without_change(found.fit.values, a), b) for a, b in twos]
    fits = fit_all(problem, starts, near=[found.fit] * len(starts), fresh=[frozenset[Knob]()] * len(starts),
                   settings=settings.results.fit)  # fmt: skip
    return [(frozenset(two), fit) for two, fit in zip(twos, fits, strict=True)]


def _moves(problem: Problem, fit: Fit, probes: Sequence[Values]) -> np.ndarray:
    """(N, W n) how much each change alters the residuals of a fit, in single precision to save memory."""
    out = np.zeros((len(probes), fit.r.size), dtype=np.float32)
    for a in range(0, len(probes), ROWS):
        moved = problem.residuals([{**fit.values, **probe} for probe in probes[a : a + ROWS]])
        for i, r in enumerate(moved, start=a):
            out[i] = np.ravel(r - fit.r)
    return out


def _exchanges(
    problem: Problem,
    gone: frozenset[Term],
    rest: Fit,
    probes: Sequence[tuple[Term, Values]],
    moves: np.ndarray,
    most: float,
) -> list[Exchange]:
    """The best probes of every pair of changes that may join `rest`, if a step along both, together with all numbers
    that are free in `rest`, predicts a cost of at most `most`."""
    left, free = rest.r.ravel(), np.linalg.qr(rest.jacobian.reshape(rest.r.size, -1))[0]
    along = moves @ free
    gram = moves @ moves.T - along @ along.T
    score = moves @ left - along @ (free.T @ left)
    own = np.maximum(np.diag(gram), TINY)
    apart = np.outer(own, own) - gram**2
    apart = np.where(apart > PARALLEL * np.outer(own, own), apart, np.inf)
    doses = (gram * score - np.outer(score, own)) / apart  # (N, N): of the first of two
    cost = left @ left - np.sum((free.T @ left) ** 2) + doses * score[:, None] + doses.T * score
    there = changed_terms(rest)
    out: dict[tuple[Term, Term], Exchange] = {}
    rows, columns = np.nonzero(np.triu(cost <= most, 1))
    for i, j in sorted(zip(rows.tolist(), columns.tolist(), strict=True), key=lambda at: float(cost[at])):
        (one, probe), (other, its) = probes[i], probes[j]
        if one == other or (one, other) in out or not problem.space.may_join(other, (*there, one)):
            continue
        sizes = float(doses[i, j]), float(doses[j, i])
        out[one, other] = Exchange(gone, rest.values, (probe, its), (one, other), sizes, float(cost[i, j]))
    return list(out.values())


def _start(problem: Problem, exchange: Exchange) -> Values:
    """Where the fit of an exchange begins."""
    (one, other), (dose, its) = exchange.probes, exchange.doses
    return {**exchange.base, **scaled_probe(problem, one, dose), **scaled_probe(problem, other, its)}
