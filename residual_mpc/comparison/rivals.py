"""What could stand in place of each change: confounded groups, and each candidate's share of the likelihood."""

from dataclasses import dataclass

import numpy as np

from residual_mpc.comparison.contrast import Units
from residual_mpc.comparison.search import FoundChanges, fitted_leads, told_apart, without_change
from residual_mpc.comparison.settings import ComparisonSettings
from residual_mpc.diagnosis.fit.least_squares import fit_all
from residual_mpc.diagnosis.predict.effect_sets import ConfoundedGroup
from residual_mpc.diagnosis.predict.problem import Problem
from residual_mpc.diagnosis.search.rivals import place
from residual_mpc.models.settings import Knob, Term


@dataclass(frozen=True)
class ChangeRivals:
    """groups: changes that the runs do not tell apart, the one to prefer first; shares: of each change, and of what
    could stand in its place."""

    groups: tuple[ConfoundedGroup, ...]
    shares: dict[Term, float]


def find_change_rivals(
    problem: Problem, found: FoundChanges, units: Units, settings: ComparisonSettings
) -> ChangeRivals:
    """Each change in turn is taken out, and what explains the difference instead is fitted in its place."""
    groups: list[ConfoundedGroup] = []
    shares: dict[Term, float] = {}
    fits = settings.results.fit
    for change in found.changes:
        start = without_change(found.fit.values, change.term)
        rest = fit_all(problem, [start], near=[found.fit], fresh=[frozenset[Knob]()], settings=fits)[0]
        told = [c for c in told_apart(problem, rest, units) if c.term != change.term]
        leads = sorted(told, key=lambda c: -c.drop)
        rivals = fitted_leads(problem, rest, leads, settings)
        weights = {change.term: 1.0}
        alike = [(change.term,)]
        for lead, fit in rivals:
            ratio = (fit.cost - found.fit.cost) / found.phi
            weights[lead.term] = max(weights.get(lead.term, 0.0), float(np.exp(-0.5 * np.clip(ratio, 0.0, 200.0))))
            if ratio < settings.search.alike and (lead.term,) not in alike:
                alike.append((lead.term,))
        total = sum(weights.values())
        for term, weight in weights.items():
            shares[term] = max(shares.get(term, 0.0), weight / total)
        if len(alike) > 1:
            groups.append(tuple(sorted(alike, key=place)))
    return ChangeRivals(tuple(groups), shares)
