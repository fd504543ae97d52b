"""What could stand in place of each change: confounded groups, and each candidate's share of the likelihood."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from residual_mpc.comparison.likelihood import Explanation, likelihood_ratios
from residual_mpc.comparison.search import FoundChange, FoundChanges, fitted_leads, told_apart, without_change
from residual_mpc.comparison.settings import ComparisonSettings
from residual_mpc.comparison.units import Units
from residual_mpc.diagnosis.fit.least_squares import Fit, fit_all
from residual_mpc.diagnosis.predict.effect_sets import ConfoundedGroup
from residual_mpc.diagnosis.predict.problem import Problem
from residual_mpc.diagnosis.search.additions import mixed
from residual_mpc.diagnosis.search.rivals import place
from residual_mpc.models.settings import Knob, Term, Values


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
    """The changes that explain much of the difference in place of one that was found, after that one.

    Each is fitted from two places: without any change in its place, what acts on both sets lies between the two; beside
    the change that was found, it lies where that change is right.
    """
    start = without_change(found.fit.values, change.term)
    rest = fit_all(problem, [start], near=[found.fit], fresh=[frozenset[Knob]()], settings=settings.results.fit)[0]
    told = [c for c in told_apart(problem, rest, units, settings).told if c.term != change.term]
    leads = mixed(sorted(told, key=lambda c: -abs(c.z)), sorted(told, key=lambda c: -c.drop))
    out = {change.term: Explanation(change.term, found.fit, rest.per_window - found.fit.per_window)}
    for one in fitted_leads(problem, rest, leads, settings, (start,)):
        out.setdefault(one.lead.term, one.explanation)
    out = _beside_all_errors(problem, change.term, out, settings)
    least = settings.search.resembles * float(out[change.term].dropped.sum())
    return {term: one for term, one in out.items() if term == change.term or float(one.dropped.sum()) >= least}


def _beside_all_errors(
    problem: Problem, found: Term, fits: dict[Term, Explanation], settings: ComparisonSettings
) -> dict[Term, Explanation]:
    """The change that was found and the rivals that leave least, fitted once more with the effects of all of them on
    both sets. This leaves the same model errors to each: one that describes an error of the model as well explains no
    more of the change by that."""
    rivals = sorted((one for term, one in fits.items() if term != found), key=lambda one: one.fit.cost)
    several = [fits[found], *rivals[: settings.search.shared]]
    errors = _errors_of(several)
    if all(errors.keys() <= one.fit.values.keys() for one in several):
        return {one.term: one for one in several}
    fits_settings = settings.results.fit
    best = min((one.fit for one in several), key=lambda fit: fit.cost)
    none: Values = {knob: problem.space.null(knob) for knob in errors}
    changes = [{knob: v for knob, v in one.fit.values.items() if knob.changed} for one in several]
    starts = [
        {**_errors(of, errors, none), **change}
        for one, change in zip(several, changes, strict=True)
        for of in (one.fit, best)
    ]
    near = [of for one in several for of in (one.fit, best)]
    rough = fit_all(problem, starts, settings.search.rough, rough=True, near=near, settings=fits_settings)
    better = [min(two, key=lambda f: f.cost) for two in zip(rough[::2], rough[1::2], strict=True)]
    ends = [_errors(best, errors, none), *(f.values for f in better)]
    common, *fitted = fit_all(problem, ends, settings=fits_settings)
    return {
        one.term: Explanation(one.term, fit, common.per_window - fit.per_window)
        for one, fit in zip(several, fitted, strict=True)
    }


def _errors(fit: Fit, errors: Values, none: Values) -> dict[Knob, float]:
    """The numbers `errors` of what acts on both sets, as a fit has them."""
    return {knob: fit.values.get(knob, none[knob]) for knob in errors}


def _errors_of(several: Sequence[Explanation]) -> Values:
    """What any of these models has on both sets; of an effect on one target and on all, the one that is met first."""
    out: dict[Knob, float] = {}
    for one in several:
        for knob, value in one.fit.values.items():
            met = {k.target for k in out if (k.effect, k.parameter) == (knob.effect, knob.parameter)}
            if not knob.changed and (not met or None not in {*met, knob.target}):
                out.setdefault(knob, value)
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
    own = first._replace(changed=False)
    errors = {k for k in fits[first].fit.knobs if not k.changed and (k in found.fit.values or k.term == own)}
    kept = {k: v for k, v in fits[first].fit.values.items() if k.changed or k in errors}
    (fit,) = fit_all(problem, [kept], near=[fits[first].fit], settings=settings.results.fit)
    changes = tuple(FoundChange(first, c.p) if c.term == change.term else c for c in found.changes)
    return replace(found, fit=fit, changes=changes)
