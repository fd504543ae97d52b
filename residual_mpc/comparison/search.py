"""Which changes explain how two sets of runs differ: forward steps from none, and what could stand in their place."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from residual_mpc.comparison.contrast import Contrast, Contrasts, contrasts
from residual_mpc.comparison.leads import FittedLead, changed_terms, fitted_leads, p_of_fit, without_change
from residual_mpc.comparison.likelihood import likelihood_ratios
from residual_mpc.comparison.settings import ComparisonSettings
from residual_mpc.comparison.units import Units
from residual_mpc.diagnosis.fit.evidence import dispersion
from residual_mpc.diagnosis.fit.least_squares import Fit, fit_all, on_problem
from residual_mpc.diagnosis.predict.problem import Problem
from residual_mpc.diagnosis.search.additions import mixed
from residual_mpc.diagnosis.search.confounded_groups import place
from residual_mpc.models.settings import Knob, Term, Values


@dataclass(frozen=True)
class FoundChange:
    """term: a change; p: probability of such a difference within one set of runs, by the test of the contrasts; by_fit:
    the same by what its fit explains (see `p_of_fit`); by_fit_alone: whether no test was significant when it was
    found."""

    term: Term
    p: float
    by_fit: float = 1.0
    by_fit_alone: bool = False


@dataclass(frozen=True, eq=False)
class FoundChanges:
    """fit: the account with the changes; account: without; left: the contrasts of what the fit leaves; phi: dispersion
    of its residuals by unit; again: what the search from the account of the runs before came to, where it found nothing
    either although every later run fits far worse; None elsewhere."""

    fit: Fit
    account: Fit
    changes: tuple[FoundChange, ...]
    left: Contrasts
    phi: float
    again: "FoundChanges | None" = None


def search_changes(
    problem: Problem,
    account: Values,
    units: Units,
    settings: ComparisonSettings,
    start: FoundChanges | None = None,
    choice: tuple[Problem, Units] | None = None,
) -> FoundChanges:
    """Forward from the account, fitted to both sets, by the change that explains most, until none is beyond what units
    of one set differ among themselves. start: the result on other windows, from which to continue; choice: a smaller
    problem and its units, on which candidates are compared. The test for a difference always uses all windows.

    Where that finds nothing although every run of the later set fits far worse than those before, the search begins
    again from the account of the runs before. A large change spoils the fit to both sets, in which each run then misses
    something else.
    """
    fits = settings.results.fit
    base = fit_all(problem, [account if start is None else start.account.values], settings=fits)[0]
    changes = () if start is None else start.changes
    current = base if start is None or not changes else fit_all(problem, [start.fit.values], settings=fits)[0]
    found = _forward(problem, base, current, changes, units, settings, choice)
    if found.changes:
        return found
    (before,) = fit_all(problem, [account], 0, settings=fits)
    if not _all_far_worse(before, units, settings):
        return found
    again = _forward(problem, before, before, (), units, settings, choice)
    return again if again.changes else replace(found, again=again)


def leading_change(problem: Problem, found: FoundChanges, settings: ComparisonSettings) -> FittedLead | None:
    """Of the changes that may be added to a fit, the one that lowers the cost most; None where none lowers it."""
    told = found.left.told
    leads = mixed(sorted(told, key=lambda c: -abs(c.z)), sorted(told, key=lambda c: -c.drop))
    best = next(iter(fitted_leads(problem, found.fit, leads, settings)), None)
    return best if best is not None and best.drop > 0.0 else None


def _all_far_worse(fit: Fit, units: Units, settings: ComparisonSettings) -> bool:
    """Whether every run of the later set leaves far more squares than every run before."""
    runs = np.unique(units.run)
    samples = units.summed(np.count_nonzero(fit.r, axis=1).astype(float))
    squares = units.summed(fit.per_window)
    left = np.array([squares[units.run == i].sum() / max(samples[units.run == i].sum(), 1.0) for i in runs])
    later = np.array([units.later[units.run == i].any() for i in runs])
    return bool(left[later].min() > settings.search.far_worse**2 * left[~later].max())


def _forward(
    problem: Problem, base: Fit, current: Fit, there: Sequence[FoundChange], units: Units,
    settings: ComparisonSettings, choice: tuple[Problem, Units] | None,
) -> FoundChanges:  # fmt: skip
    """Further changes on top of those of the fit `current`; base: the account without them."""
    tuned, changes = settings.search, list(there)
    while True:
        differences = told_apart(problem, current, units, settings)
        best = None
        level = settings.contrast.left if changes else settings.contrast.level
        if len(changes) < tuned.most and differences.p <= level:
            if choice is None:
                best = _best(problem, current, units, differences.told, settings)
            else:
                best = _chosen(problem, units, choice, current, differences.told, settings)
        if best is None and len(changes) < tuned.most and differences.p > level:
            best = _dominant(problem, current, units, differences.told, level, settings)
        if best is None:
            return FoundChanges(current, base, tuple(changes), differences, dispersion(current, units.number))
        current, change = best
        changes.append(change)
        current, changes = _pruned(problem, current, changes, units, settings)


def told_apart(problem: Problem, current: Fit, units: Units, settings: ComparisonSettings) -> Contrasts:
    """The contrast of every probe of every change that may be added to a fit."""
    return contrasts(problem, current, units, probes_of(problem, current), settings.contrast)


def probes_of(problem: Problem, current: Fit) -> list[tuple[Term, Values]]:
    """Every probe of every change that may be added to a fit."""
    there = changed_terms(current)
    open_ = [t for t in problem.space.candidates if problem.space.may_join(t, there)]
    return [(t, p) for t in open_ for p in problem.space.probes(t)]


def _chosen(
    problem: Problem,
    units: Units,
    choice: tuple[Problem, Units],
    current: Fit,
    told: Sequence[Contrast],
    settings: ComparisonSettings,
) -> tuple[Fit, FoundChange] | None:
    """The best change on fewer windows, fitted on all of them. The likelihood ratio grows with the number of windows,
    so the minimum is lower on fewer; on all of them the change must be significant or reach the minimum."""
    fits, tuned = settings.results.fit, settings.search
    fewer, their_units = choice
    here = fit_all(fewer, [current.values], settings=fits)[0]
    needed = tuned.needed * min(fewer.data.count / problem.data.count, 1.0)
    found = _best(fewer, here, their_units, told, replace(settings, search=replace(tuned, needed=needed)))
    if found is None:
        return None
    fit = fit_all(problem, [found[0].values], settings=fits)[0]
    worth = (current.cost - fit.cost) / dispersion(fit, units.number)
    return (fit, found[1]) if found[1].p <= settings.contrast.level or worth >= tuned.needed else None


def _best(
    problem: Problem, current: Fit, units: Units, told: Sequence[Contrast], settings: ComparisonSettings
) -> tuple[Fit, FoundChange] | None:
    """Of the changes that are significant by themselves, since something differs beyond doubt, the one that explains
    more than each of the others, and of those that explain as much the first in the contract's table; None where none
    qualifies."""
    beyond = [c for c in told if c.alone <= settings.contrast.level]
    leads = mixed(sorted(beyond, key=lambda c: -abs(c.z)), sorted(beyond, key=lambda c: -c.drop))
    p = {term: min(c.p for c in beyond if c.term == term) for term in {c.term for c in beyond}}
    fitted = [
        one
        for one in fitted_leads(problem, current, leads, settings)
        if one.drop > 0.0
        and (
            p[one.lead.term] <= settings.contrast.level
            or one.drop / dispersion(one.fit, units.number) >= settings.search.needed
        )
    ]
    if not fitted:
        return None
    explanations = [one.explanation for one in fitted]
    phi = dispersion(min((one.fit for one in fitted), key=lambda fit: fit.cost), units.number)
    ratios = likelihood_ratios(problem, explanations, units, phi, settings.contrast)
    worst = ratios.min(axis=1)
    equal = [one for one, ratio in zip(fitted, worst, strict=True) if worst.max() - ratio < settings.search.equal]
    best = min(equal, key=lambda one: place((one.lead.term,)))
    by_fit = p_of_fit(best, phi, units, len({c.term for c in told}))
    return best.fit, FoundChange(best.lead.term, p[best.lead.term], by_fit)


def _dominant(
    problem: Problem, current: Fit, units: Units, told: Sequence[Contrast], level: float, settings: ComparisonSettings
) -> tuple[Fit, FoundChange] | None:
    """The fit with a change that removes most of all that is left, where no test is significant and its fit is; None
    where there is none. A stop that a joint meets in a few stretches is such a change: the others tell nothing of it,
    so that the differences of all of them cannot become significant."""
    least = settings.search.dominant * current.cost
    leads = sorted((c for c in told if c.drop >= least), key=lambda c: -c.drop)
    fitted = [one for one in fitted_leads(problem, current, leads, settings) if one.drop >= least] if leads else []
    if not fitted:
        return None
    best = fitted[0]
    by_fit = p_of_fit(best, dispersion(best.fit, units.number), units, len({c.term for c in told}))
    p = min(c.p for c in told if c.term == best.lead.term)
    return (best.fit, FoundChange(best.lead.term, p, by_fit, True)) if by_fit <= level else None


def _pruned(
    problem: Problem, current: Fit, changes: list[FoundChange], units: Units, settings: ComparisonSettings
) -> tuple[Fit, list[FoundChange]]:
    """Without the changes that later ones have made needless."""
    needed = settings.search.needed
    while len(changes) > 1:
        phi = dispersion(current, units.number)
        starts = [without_change(current.values, c.term) for c in changes[:-1]]
        fewer = fit_all(problem, starts, settings.search.rough, near=[current] * len(starts),
                        fresh=[frozenset[Knob]()] * len(starts), settings=settings.results.fit)  # fmt: skip
        least = int(np.argmin([f.cost for f in fewer]))
        probes = [(changes[least].term, p) for p in problem.space.probes(changes[least].term)]
        z = max(abs(c.z) for c in contrasts(problem, fewer[least], units, probes, settings.contrast).told)
        if max(z**2, (fewer[least].cost - current.cost) / phi) > needed:
            break
        current = on_problem(problem, fewer[least], settings=settings.results.fit)
        changes = [c for i, c in enumerate(changes) if i != least]
    return current, changes
