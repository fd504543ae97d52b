"""What could stand in place of each change: confounded groups, and each candidate's share of the likelihood."""

from dataclasses import dataclass, replace

import numpy as np

from residual_mpc.comparison.likelihood import Explanation, likelihood_ratios
from residual_mpc.comparison.search import FoundChange, FoundChanges, fitted_leads, told_apart, without_change
from residual_mpc.comparison.settings import ComparisonSettings
from residual_mpc.comparison.units import Units
from residual_mpc.diagnosis.fit.least_squares import fit_all, on_problem
from residual_mpc.diagnosis.predict.effect_sets import ConfoundedGroup
from residual_mpc.diagnosis.predict.problem import Problem
from residual_mpc.diagnosis.search.additions import mixed
from residual_mpc.diagnosis.search.rivals import place
from residual_mpc.models.settings import Knob, Term


@dataclass(frozen=True)
class ChangeRivals:
    """found: the changes, of a group the member that explains most; groups: changes that the runs do not tell apart;
    shares: of the likelihood, of each change and of what could stand in its place; parts: of what all changes explain,
    that which only this one does."""

    found: FoundChanges
    groups: tuple[ConfoundedGroup, ...]
    shares: dict[Term, float]
    parts: dict[Term, float]


def find_change_rivals(
    problem: Problem, found: FoundChanges, units: Units, settings: ComparisonSettings
) -> ChangeRivals:
    """Each change in turn is taken out, and what explains the difference instead is fitted in its place."""
    groups: list[ConfoundedGroup] = []
    shares: dict[Term, float] = {}
    parts: dict[Term, float] = {}
    together = max(found.account.cost - found.fit.cost, 1e-12)
    for change in found.changes:
        fits = _in_place_of(problem, found, change, units, settings)
        explained = list(fits.values())
        beyond = likelihood_ratios(problem, explained, units, found.phi, settings.contrast)[0]
        ratios = {one.term: float(ratio - beyond.min()) for one, ratio in zip(explained, beyond, strict=True)}
        weights = {term: float(np.exp(-0.5 * min(ratio, 200.0))) for term, ratio in ratios.items()}
        total = sum(weights.values())
        for term, weight in weights.items():
            shares[term] = max(shares.get(term, 0.0), weight / total)
        alike = sorted((t for t, ratio in ratios.items() if ratio < settings.search.alike), key=lambda t: place((t,)))
        if len(alike) > 1:
            groups.append(tuple((term,) for term in alike))
        first = next(term for term in alike if ratios[term] < settings.search.equal)
        parts[first] = float(fits[change.term].dropped.sum()) / together
        found = _preferring(problem, found, change, first, fits, settings)
    return ChangeRivals(found, tuple(groups), shares, parts)


def _in_place_of(
    problem: Problem, found: FoundChanges, change: FoundChange, units: Units, settings: ComparisonSettings
) -> dict[Term, Explanation]:
    """The changes that explain much of the difference in place of one that was found, after that one."""
    start = without_change(found.fit.values, change.term)
    rest = fit_all(problem, [start], near=[found.fit], fresh=[frozenset[Knob]()], settings=settings.results.fit)[0]
    told = [c for c in told_apart(problem, rest, units, settings).told if c.term != change.term]
    leads = mixed(sorted(told, key=lambda c: -abs(c.z)), sorted(told, key=lambda c: -c.drop))
    out = {change.term: Explanation(change.term, found.fit, rest.per_window - found.fit.per_window)}
    least = settings.search.resembles * (rest.cost - found.fit.cost)
    for one in fitted_leads(problem, rest, leads, settings):
        if one.drop >= least:
            out.setdefault(one.lead.term, one.explanation)
    return out


def _preferring(
    problem: Problem,
    found: FoundChanges,
    change: FoundChange,
    first: Term,
    fits: dict[Term, Explanation],
    settings: ComparisonSettings,
) -> FoundChanges:
    """The changes with the first of those that explain most, by the contract's table, in place of the one that was
    found."""
    if first == change.term:
        return found
    fit = on_problem(problem, fits[first].fit, settings=settings.results.fit)
    changes = tuple(FoundChange(first, c.p) if c.term == change.term else c for c in found.changes)
    return replace(found, fit=fit, changes=changes)
