"""Two changes in place of two others.

Forward steps that begin with the wrong change make up for it with a second wrong one, and exchanging one of them alone
does not help: beside a wrong partner, neither right one fits. Two are therefore taken out at once. One Gauss-Newton
step along every two directions (Nocedal and Wright 2006, eq. 10.23) predicts what other two leave, and the best
are fitted.
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
PARALLEL = 1e-4  # 1 - squared cosine of two directions below which they are one
TINY = 1e-30


@dataclass(frozen=True)
class Exchange:
    """gone: the changes that are taken out, and the values without them; probes: those that take their places, with the
    factors `doses` by which the step multiplies them; cost: what the step predicts."""

    gone: frozenset[Term]
    base: Values
    probes: tuple[Values, Values]
    terms: tuple[Term, Term]
    doses: tuple[float, float]
    cost: float


def exchanged(problem: Problem, found: FoundChanges, units: Units, settings: ComparisonSettings) -> FoundChanges:
    """The changes, of which two are exchanged for two others as long as that explains more by what a change has to."""
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
    """The changes with the new ones, each as significant as the less significant of those that it stands for: what the
    two explain together is the same difference."""
    gone = [c for c in found.changes if c.term in exchange.gone]
    kept = [c for c in found.changes if c.term not in exchange.gone]
    p, by_fit = max(c.p for c in gone), max(c.by_fit for c in gone)
    by_fit_alone = any(c.by_fit_alone for c in gone)
    return (*kept, *(FoundChange(term, p, by_fit, by_fit_alone) for term in exchange.terms))


def _predicted_best(problem: Problem, found: FoundChanges, settings: ComparisonSettings) -> list[Exchange]:
    """The exchanges that may explain more, those of the least predicted cost first."""
    probes = probes_of(problem, found.fit)
    moves = _moves(problem, found.fit, [probe for _, probe in probes])
    out = []
    for gone, rest in _without_two(problem, found, settings):
        out += _exchanges(problem, gone, rest, probes, moves, settings.search.exchanges * found.fit.cost)
    return sorted(out, key=lambda e: e.cost)[: settings.search.shortlist]


def _without_two(
    problem: Problem, found: FoundChanges, settings: ComparisonSettings
) -> list[tuple[frozenset[Term], Fit]]:
    """Every two of the changes, and the fit without them."""
    twos = list(combinations((c.term for c in found.changes), 2))
    starts = [without_change(without_change(found.fit.values, a), b) for a, b in twos]
    fits = fit_all(problem, starts, near=[found.fit] * len(starts), fresh=[frozenset[Knob]()] * len(starts),
                   settings=settings.results.fit)  # fmt: skip
    return [(frozenset(two), fit) for two, fit in zip(twos, fits, strict=True)]


def _moves(problem: Problem, fit: Fit, probes: Sequence[Values]) -> np.ndarray:
    """(N, W n) by how much each change moves the residuals of a fit, in single precision to save memory."""
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
    """For every two changes that may join what is left, their best probes, if a step along both, beside all that is
    free in `rest`, predicts a cost of at most `most`."""
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
