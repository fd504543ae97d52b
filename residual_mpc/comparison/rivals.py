"""What could stand in place of each change: confounded groups, and each candidate's share of the likelihood."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from residual_mpc.comparison.leads import changed_terms, fitted_leads, without_change
from residual_mpc.comparison.likelihood import Explanation, likelihood_ratios
from residual_mpc.comparison.search import FoundChange, FoundChanges, told_apart
from residual_mpc.comparison.settings import ComparisonSettings
from residual_mpc.comparison.units import Units
from residual_mpc.diagnosis.fit.least_squares import Fit, fit_all
from residual_mpc.diagnosis.predict.effect_sets import ConfoundedGroup
from residual_mpc.diagnosis.predict.problem import Problem
from residual_mpc.diagnosis.search.additions import mixed
from residual_mpc.diagnosis.search.confounded_groups import place
from residual_mpc.diagnosis.search.substitutes import counting_what_includes, imitate
from residual_mpc.effects.actuator import ACTUATOR_GAIN
from residual_mpc.effects.body import JOINT_COMPLIANCE
from residual_mpc.effects.position_servo import POSITION_GAIN
from residual_mpc.models.settings import Knob, Term, Values

# a servo of lower gain yields to a load as one behind a spring does; only fast motions tell the two apart
YIELDING = tuple({gain.name, JOINT_COMPLIANCE.name} for gain in (ACTUATOR_GAIN, POSITION_GAIN))


@dataclass(frozen=True)
class ChangeRivals:
    """found: the changes, of a group the member that explains most; groups: changes that the runs do not tell apart;
    places: by change, the shares of the likelihood that it and what could stand in its place have; parts: of what all
    changes explain, that which only this one does."""

    found: FoundChanges
    groups: tuple[ConfoundedGroup, ...]
    places: dict[Term, dict[Term, float]]
    parts: dict[Term, float]

    @property
    def shares(self) -> dict[Term, float]:
        """The largest share of each change, over all places that it could take."""
        out: dict[Term, float] = {}
        for of in self.places.values():
            for term, share in of.items():
                out[term] = max(out.get(term, 0.0), share)
        return out

    def of(self, found: FoundChanges) -> "ChangeRivals":
        """Those of the changes that are left."""
        terms = {c.term for c in found.changes}
        groups = tuple(g for g in self.groups if any((t,) in g for t in terms))
        return replace(self, found=found, groups=groups, places={t: p for t, p in self.places.items() if t in terms})


def find_change_rivals(
    problem: Problem, found: FoundChanges, units: Units, settings: ComparisonSettings
) -> ChangeRivals:
    """Each change in turn is taken out, and what explains the difference instead is fitted in its place.

    Changes that explain next to nothing stay aside meanwhile: free beside a rival, such a change would take a size that
    nothing else supports, and with it the rival would explain what another change does.
    """
    groups: list[ConfoundedGroup] = []
    places: dict[Term, dict[Term, float]] = {}
    parts: dict[Term, float] = {}
    together = max(found.account.cost - found.fit.cost, 1e-12)
    share = {c.term: (_rest_of(problem, found, c, settings).cost - found.fit.cost) / together for c in found.changes}
    for change in found.changes:
        main = _without_faint(problem, found, change, share, settings)
        rest = _rest_of(problem, main, change, settings)
        fits = _in_place_of(problem, main.fit, change.term, rest, units, settings)
        beyond = {change.term: 0.0} | {
            term: float(likelihood_ratios(problem, pair, units, found.phi, settings.contrast)[0, 1])
            for term, pair in fits.items()
        }
        ratios = {term: ratio - min(beyond.values()) for term, ratio in beyond.items()}
        alone = _alone_as_good(problem, found, change, fits, ratios, units, settings)
        if alone is not None:
            return find_change_rivals(problem, alone, units, settings)
        leading = next(term for term, ratio in ratios.items() if ratio == 0.0)
        equal = {t for t, ratio in ratios.items() if _hardly_told(problem, t, leading, ratio, settings)}
        weights = {t: float(np.exp(-0.5 * min(r, 200.0))) if t not in equal else 1.0 for t, r in ratios.items()}
        total = sum(weights.values())
        alike = sorted(equal | {t for t, r in ratios.items() if r < settings.search.alike}, key=lambda t: place((t,)))
        shares = {term: weight / total for term, weight in counting_what_includes(weights, alike).items()}
        if len(alike) > 1:
            groups.append(tuple((term,) for term in alike))
        first = next(term for term in alike if ratios[term] < settings.search.equal)
        places[first], parts[first] = shares, share[change.term]
        if first != change.term:
            found = _replaced(problem, found, change, fits[first][1], settings)
            if len(found.changes) < len(share):  # it was there already
                return find_change_rivals(problem, found, units, settings)
    return ChangeRivals(found, tuple(groups), places, parts)


def _without_faint(
    problem: Problem,
    found: FoundChanges,
    change: FoundChange,
    share: Mapping[Term, float],
    settings: ComparisonSettings,
) -> FoundChanges:
    """Without the other changes that explain next to nothing, the faintest first, as far as all of them together do.
    share: of what all changes explain, that which only each of them does."""
    faint = [c for c in found.changes if c.term != change.term and share.get(c.term, 1.0) < settings.faint]
    together = max(found.account.cost - found.fit.cost, 1e-12)
    for count in range(len(faint), 0, -1):
        main = _without(problem, found, sorted(faint, key=lambda c: share[c.term])[:count], settings)
        if main.fit.cost - found.fit.cost < settings.faint * together:
            return main
    return found


def _rest_of(problem: Problem, found: FoundChanges, change: FoundChange, settings: ComparisonSettings) -> Fit:
    """The fit without one of the changes."""
    return _without(problem, found, [change], settings).fit


def _without(
    problem: Problem, found: FoundChanges, aside: Sequence[FoundChange], settings: ComparisonSettings
) -> FoundChanges:
    """Without some of the changes, fitted again."""
    if not aside:
        return found
    values = found.fit.values
    for change in aside:
        values = without_change(values, change.term)
    fit = fit_all(problem, [values], near=[found.fit], fresh=[frozenset[Knob]()], settings=settings.results.fit)[0]
    return replace(found, fit=fit, changes=tuple(c for c in found.changes if c not in aside))


def _alone_as_good(
    problem: Problem,
    found: FoundChanges,
    change: FoundChange,
    fits: dict[Term, tuple[Explanation, Explanation]],
    ratios: dict[Term, float],
    units: Units,
    settings: ComparisonSettings,
) -> FoundChanges | None:
    """A single change that explains as much as all of those that were found: a rival of one of them beside which the
    others together are worth less than one change has to be; None where there is none. Forward steps that begin with
    the wrong change make up for it with further ones. ratios: of the change and its rivals to the best of them."""
    others = [c.term for c in found.changes if c.term != change.term]
    near = sorted((t for t in fits if ratios[t] < settings.search.hardly), key=lambda t: ratios[t])
    if not others or not near:
        return None
    starts = []
    for term in near:
        values = _without_foreign_errors(found, fits[term][1])
        for other in others:
            values = without_change(values, other)
        starts.append(values)
    for term, fit in zip(near, fit_all(problem, starts, settings=settings.results.fit), strict=True):
        fewer = (len(found.fit.knobs) - len(fit.knobs)) * float(np.log(units.count))
        if (fit.cost - found.fit.cost) / found.phi - fewer < settings.search.needed:
            return replace(found, fit=fit, changes=(replace(change, term=term),))
    return None


def _hardly_told(problem: Problem, one: Term, other: Term, ratio: float, settings: ComparisonSettings) -> bool:
    """Whether an effect imitates the one that explains most and their likelihood ratio is too small to tell them apart.
    Twins do the same, so no ratio tells them apart."""
    if problem.space.are_twins(one, other):
        return True
    yielding = one.target == other.target and {one.effect, other.effect} in YIELDING
    return (yielding or imitate(one, other)) and ratio < settings.search.hardly


def _in_place_of(
    problem: Problem, fit: Fit, change: Term, rest: Fit, units: Units, settings: ComparisonSettings
) -> dict[Term, tuple[Explanation, Explanation]]:
    """A change of a fit and each rival that explains much of the difference in its place, the change first. rest: the
    fit without the change.

    A rival is fitted from two places: without any change in its place, what acts on both sets lies between the two;
    beside the change that was found, it lies where that change is right.
    """
    told = [c for c in told_apart(problem, rest, units, settings).told if c.term != change]
    leads = mixed(sorted(told, key=lambda c: -abs(c.z)), sorted(told, key=lambda c: -c.drop))
    fitted = fitted_leads(problem, rest, leads, settings, (without_change(fit.values, change),))
    better = [one for one in fitted if one.drop > 0.0]  # than with the effect on both sets, as an error of the model
    best = sorted(better, key=lambda one: one.fit.cost)[: settings.search.rivals]
    rivals = {one.lead.term: one.fit for one in best} | _twins_of(problem, fit, change, rest, settings)
    pairs = {term: _beside_same_errors(problem, fit, change, term, its, settings) for term, its in rivals.items()}
    least = settings.search.resembles
    return {t: (own, its) for t, (own, its) in pairs.items() if its.dropped.sum() >= least * own.dropped.sum()}


def _twins_of(problem: Problem, fit: Fit, change: Term, rest: Fit, settings: ComparisonSettings) -> dict[Term, Fit]:
    """What no run here can tell from a change, with its numbers."""
    space, there = problem.space, changed_terms(rest)
    twins = [t for t in space.candidates if space.are_twins(t, change) and space.may_join(t, there)]
    starts = [
        {Knob(t.effect, t.target, k.parameter, k.changed) if k.changed and k.term == change else k: v
         for k, v in fit.values.items()}
        for t in twins
    ]  # fmt: skip
    return dict(zip(twins, fit_all(problem, starts, settings=settings.results.fit), strict=True))


def _beside_same_errors(
    problem: Problem, fit: Fit, change: Term, term: Term, rival: Fit, settings: ComparisonSettings
) -> tuple[Explanation, Explanation]:
    """A change and a rival, fitted once more with the effects of both on both sets. This leaves the same model errors
    to either: one whose effect also describes an error of the model explains no more of the change by that."""
    errors = _errors_of([fit, rival])
    both = {k: fit.values.get(k, problem.space.null(k)) for k in errors}
    own = {k: v for k, v in fit.values.items() if k.changed and k.term == change}
    its = {k: v for k, v in rival.values.items() if k.changed and k.term == term}
    others = {k: v for k, v in fit.values.items() if k.changed and k.term != change}
    alone = {k: rival.values.get(k, v) for k, v in both.items()}
    starts = [{**both, **others}, {**both, **others, **own}, {**both, **others, **its}, {**alone, **others, **its}]
    near = [fit, fit, fit, rival]
    common, mine, *its_ends = fit_all(problem, starts, near=near, settings=settings.results.fit)
    best = min(its_ends, key=lambda f: f.cost)
    return (
        Explanation(change, mine, common.per_window - mine.per_window),
        Explanation(term, best, common.per_window - best.per_window),
    )


def _errors_of(fits: Sequence[Fit]) -> list[Knob]:
    """What any of these fits has on both sets; of an effect on one target and on all, the one that is met first."""
    out: list[Knob] = []
    for knob in (k for fit in fits for k in fit.knobs if not k.changed):
        met = {k.target for k in out if (k.effect, k.parameter) == (knob.effect, knob.parameter)}
        if knob not in out and (not met or None not in {*met, knob.target}):
            out.append(knob)
    return out


def _replaced(
    problem: Problem, found: FoundChanges, change: FoundChange, by: Explanation, settings: ComparisonSettings
) -> FoundChanges:
    """The changes with another one in place of one of them, which may be among them already."""
    kept = {k: v for k, v in found.fit.values.items() if k.changed and k.term != change.term}
    start = {**kept, **_without_foreign_errors(found, by)}
    (fit,) = fit_all(problem, [start], near=[by.fit], settings=settings.results.fit)
    left = (c for c in found.changes if c.term != by.term)
    changes = tuple(replace(c, term=by.term) if c.term == change.term else c for c in left)
    return replace(found, fit=fit, changes=changes)


def _without_foreign_errors(found: FoundChanges, by: Explanation) -> Values:
    """The values of a rival's fit without the effects on both sets that came from other rivals."""
    own = by.term._replace(changed=False)
    return {k: v for k, v in by.fit.values.items() if k.changed or k in found.fit.values or k.term == own}
